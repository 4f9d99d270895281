"""`ros2 run gcl_ros registrar`: the program of `gcl_ros.registrar_node`."""

from __future__ import annotations

import sys

from gcl_ros.program import run_node


def main() -> int:
    """Run the node until Ctrl-C or SIGTERM; returns an exit code."""
    return run_node(
        'registrar',
        'Two PointCloud2 topics in (source/points, target/points), their relative transform out.',
        [
            'ros2 run gcl_ros registrar --ros-args -r source/points:=/b/points '
            '-r target/points:=/a/points',
            'ros2 run gcl_ros registrar --ros-args --params-file registrar.yaml',
        ],
        _load,
    )


def _load() -> type:
    from gcl_ros.registrar_node import RegistrarNode

    return RegistrarNode


if __name__ == '__main__':
    sys.exit(main())

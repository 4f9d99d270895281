"""`ros2 run gcl_ros registrar`: the program of `gcl_ros.registrar_node`."""

from __future__ import annotations

import argparse
import sys

from gcl_ros.program import node_parser, run_node


def parser() -> argparse.ArgumentParser:
    """Everything that `registrar` takes."""
    return node_parser(
        'registrar',
        'Two PointCloud2 topics in (source/points, target/points), their relative transform out.',
        [
            'ros2 run gcl_ros registrar --ros-args -r source/points:=/b/points '
            '-r target/points:=/a/points',
            'ros2 run gcl_ros registrar --ros-args -p registrar.headings:=1',
        ],
    )


def main() -> int:
    """Run the node until Ctrl-C or SIGTERM; returns an exit code."""
    return run_node(parser(), _load)


def _load() -> type:
    from gcl_ros.registrar_node import RegistrarNode

    return RegistrarNode


if __name__ == '__main__':
    sys.exit(main())

"""`ros2 run gcl_ros sender`: the program of `gcl_ros.sender_node`."""

from __future__ import annotations

import argparse
import sys

from gcl_ros.program import node_parser, run_node


def parser() -> argparse.ArgumentParser:
    """Everything that `sender` takes."""
    return node_parser(
        'sender',
        'A PointCloud2 topic in (points), its scans in 10 kB each out (compact).',
        [
            'ros2 run gcl_ros sender --ros-args -r points:=/b/points -r compact:=/b/compact',
            'ros2 run gcl_ros sender --ros-args -p voxel_size:=0.5',
        ],
    )


def main() -> int:
    """Run the node until Ctrl-C or SIGTERM; returns an exit code."""
    return run_node(parser(), _load)


def _load() -> type:
    from gcl_ros.sender_node import SenderNode

    return SenderNode


if __name__ == '__main__':
    sys.exit(main())

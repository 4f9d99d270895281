"""`ros2 run gcl_ros describer`: the program of `gcl_ros.describer_node`."""

from __future__ import annotations

import argparse
import sys

from gcl_ros.program import node_parser, run_node


def parser() -> argparse.ArgumentParser:
    """Everything that `describer` takes."""
    return node_parser(
        'describer',
        'A PointCloud2 topic in (points), features of its scans out (features).',
        [
            'ros2 run gcl_ros describer --ros-args -r points:=/b/points -r features:=/b/features',
        ],
    )


def main() -> int:
    """Run the node until Ctrl-C or SIGTERM; returns an exit code."""
    return run_node(parser(), _load)


def _load() -> type:
    from gcl_ros.describer_node import DescriberNode

    return DescriberNode


if __name__ == '__main__':
    sys.exit(main())

"""`ros2 run gcl_ros describer`: the former name of `sender`, kept for one release."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from typing import TYPE_CHECKING

from gcl_ros.program import node_parser, run_node

if TYPE_CHECKING:
    from gcl_ros.sender_node import SenderNode

RENAMED = (
    'describer is now called sender: use sender; its topic features is now compact, and carries '
    'the scan itself'
)


def parser() -> argparse.ArgumentParser:
    """Everything that `describer` takes."""
    return node_parser(
        'describer',
        'The former name of sender, which it warns of and runs: points in, compact out.',
        ['ros2 run gcl_ros sender --ros-args -r points:=/b/points -r compact:=/b/compact'],
        config='sender',
    )


def main() -> int:
    """Warn and run the node until Ctrl-C or SIGTERM; returns an exit code."""
    return run_node(parser(), _load)


def _load() -> Callable[[], SenderNode]:
    from gcl_ros.sender_node import SenderNode

    def warned() -> SenderNode:
        node = SenderNode()
        node.get_logger().warning(RENAMED)
        return node

    return warned


if __name__ == '__main__':
    sys.exit(main())

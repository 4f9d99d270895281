"""`ros2 run gcl_ros replay BAG`: a bag onto its topics, with the clock, at a rate."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from gcl_core.cli.outcome import loading, run_command
from gcl_core.cli.parsers.form import form, parsed
from gcl_core.cli.parsers.quantities import not_negative, positive
from gcl_core.errors import INTERRUPTED
from gcl_ros.program import own_arguments


def parser() -> argparse.ArgumentParser:
    """Everything that `replay` takes."""
    made = argparse.ArgumentParser(
        prog='replay',
        **form(
            'Publish the messages of a bag on its topics, with the clock, at a rate.\n'
            'ROS arguments follow after --ros-args.',
            [
                'gcl bag from-simulator 7 bag_7 --distance 20 --every 20',
                'ros2 run gcl_ros replay bag_7 --rate 0.2',
            ],
        ),
    )
    made.add_argument('bag', type=Path, help='rosbag2 folder, as `gcl bag` writes it')
    made.add_argument(
        '--rate', type=positive, default=1.0, help='bag seconds a second; default: %(default)g'
    )
    made.add_argument(
        '--start', type=not_negative, default=0.0, help='seconds to skip; default: %(default)g'
    )
    made.add_argument('--loop', action='store_true', help='start again at the end')
    made.add_argument('--no-clock', action='store_true', help='do not publish /clock')
    made.add_argument('--best-effort', action='store_true', help='clouds as drivers send them')
    made.add_argument('--no-wait', action='store_true', help='do not wait for subscribers')
    return made


def main() -> int:
    """Parse the command line and replay; returns an exit code."""
    return run_command('replay', _run)


def _run() -> int:
    return _replay(parsed(parser(), own_arguments(sys.argv[1:])))


def _replay(options: argparse.Namespace) -> int:
    with loading():
        from rclpy.node import Node

        from gcl_ros.playback import Playback, replay
        from gcl_ros.startup import running_ros

    playback = Playback(
        rate=options.rate,
        start=options.start,
        loop=options.loop,
        clock=not options.no_clock,
        reliable=not options.best_effort,
        wait=not options.no_wait,
    )
    with running_ros():
        node = Node('replay')
        try:
            count = replay(options.bag, playback, node)
        except RuntimeError:  # rcl's own, where ROS is told to stop meanwhile
            if node.context.ok():
                raise
            return INTERRUPTED
        if not node.context.ok():
            return INTERRUPTED
        node.get_logger().info(f'{count} messages replayed')
        node.destroy_node()
    return 0


if __name__ == '__main__':
    sys.exit(main())

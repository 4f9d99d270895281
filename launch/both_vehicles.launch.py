"""Both vehicles, compact scans between them: each has a sender and a registrar of its own.

`ros2 launch gcl_ros both_vehicles.launch.py a:=vehicle_a b:=vehicle_b` expects the clouds on
`/vehicle_a/points` and `/vehicle_b/points`; with `motion.odometry` the odometry on
`/vehicle_a/odometry` and `/vehicle_b/odometry`. Each registrar takes its own raw points as target
and the other's compact scans as source. Start it with `only:=a` on one vehicle, `only:=b` on the
other. With odometry, set `odometry` of the sender too, which undoes the motion during its scans.
"""

import os

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, GroupAction, SetEnvironmentVariable
from launch.conditions import IfCondition
from launch.substitutions import (
    EnvironmentVariable,
    LaunchConfiguration,
    PathJoinSubstitution,
    PythonExpression,
)
from launch_ros.actions import Node
from launch_ros.substitutions import FindPackageShare

# What names the profile: Fast DDS 2 reads the old variable only, version 3 calls it deprecated.
OLD = os.environ.get('ROS_DISTRO') in ('humble', 'iron', 'jazzy')
PROFILE = 'FASTRTPS_DEFAULT_PROFILES_FILE' if OLD else 'FASTDDS_DEFAULT_PROFILES_FILE'


def vehicle(own: str, other: str) -> GroupAction:
    """Sender and registrar of one vehicle; `own` and `other` name launch arguments."""
    remappings = [
        ('target/points', ['/', LaunchConfiguration(own), '/points']),
        ('source/points', ['/', LaunchConfiguration(other), '/compact']),
        ('target/odometry', ['/', LaunchConfiguration(own), '/odometry']),
        ('source/odometry', ['/', LaunchConfiguration(other), '/odometry']),
    ]
    common = {
        'arguments': ['--ros-args', '--log-level', LaunchConfiguration('log_level')],
        'respawn': LaunchConfiguration('respawn'),
        'respawn_delay': 2.0,
        'output': 'screen',
    }
    chosen = PythonExpression(["'", LaunchConfiguration('only'), f"' in ('both', '{own}')"])
    return GroupAction(
        [
            Node(
                package='gcl_ros',
                executable='sender',
                namespace=LaunchConfiguration(own),
                parameters=[LaunchConfiguration('sender_params')],
                **common,
            ),
            Node(
                package='gcl_ros',
                executable='registrar',
                namespace=LaunchConfiguration(own),
                parameters=[LaunchConfiguration('registrar_params')],
                remappings=remappings,
                **common,
            ),
        ],
        condition=IfCondition(chosen),
    )


def generate_launch_description() -> LaunchDescription:
    """Declare the arguments and the nodes of both vehicles."""
    config = PathJoinSubstitution([FindPackageShare('gcl_ros'), 'config'])
    profile = PathJoinSubstitution([config, 'fastdds.xml'])
    return LaunchDescription(
        [
            DeclareLaunchArgument('a', default_value='vehicle_a', description='namespace'),
            DeclareLaunchArgument('b', default_value='vehicle_b', description='namespace'),
            DeclareLaunchArgument(
                'only',
                default_value='both',
                choices=['both', 'a', 'b'],
                description='whose nodes to start',
            ),
            DeclareLaunchArgument(
                'registrar_params',
                default_value=PathJoinSubstitution([config, 'registrar.yaml']),
                description='parameters of the registrars',
            ),
            DeclareLaunchArgument(
                'sender_params',
                default_value=PathJoinSubstitution([config, 'sender.yaml']),
                description='parameters of the senders',
            ),
            DeclareLaunchArgument(
                'respawn', default_value='false', description='start nodes again if they die'
            ),
            DeclareLaunchArgument(
                'log_level', default_value='info', description='debug, info, warn or error'
            ),
            SetEnvironmentVariable(
                PROFILE,
                EnvironmentVariable(PROFILE, default_value=profile),
            ),
            vehicle('a', 'b'),
            vehicle('b', 'a'),
        ]
    )

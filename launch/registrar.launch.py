"""One registrar: `ros2 launch gcl_ros registrar.launch.py source:=/b/points target:=/a/points`.

The odometry of both is listened to when `motion.odometry` is set in the parameters.
"""

import os

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, SetEnvironmentVariable
from launch.substitutions import EnvironmentVariable, LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.substitutions import FindPackageShare

# What names the profile: Fast DDS 2 reads the old variable only, version 3 calls it deprecated.
OLD = os.environ.get('ROS_DISTRO') in ('humble', 'iron', 'jazzy')
PROFILE = 'FASTRTPS_DEFAULT_PROFILES_FILE' if OLD else 'FASTDDS_DEFAULT_PROFILES_FILE'


def shared(*parts: str) -> PathJoinSubstitution:
    """Path of an installed file of this package."""
    return PathJoinSubstitution([FindPackageShare('gcl_ros'), *parts])


def generate_launch_description() -> LaunchDescription:
    """Declare the arguments and the node."""
    return LaunchDescription(
        [
            DeclareLaunchArgument('source', description='clouds of the other vehicle'),
            DeclareLaunchArgument('target', description='own clouds'),
            DeclareLaunchArgument(
                'source_odometry',
                default_value='source/odometry',
                description="the other vehicle's nav_msgs/Odometry",
            ),
            DeclareLaunchArgument(
                'target_odometry',
                default_value='target/odometry',
                description='own nav_msgs/Odometry',
            ),
            DeclareLaunchArgument('name', default_value='registrar', description='of the node'),
            DeclareLaunchArgument('namespace', default_value='', description='of the node'),
            DeclareLaunchArgument(
                'params_file',
                default_value=shared('config', 'registrar.yaml'),
                description='parameters of the node',
            ),
            DeclareLaunchArgument(
                'use_sim_time', default_value='false', description='take the time from /clock'
            ),
            DeclareLaunchArgument(
                'respawn', default_value='false', description='start the node again if it dies'
            ),
            DeclareLaunchArgument(
                'log_level', default_value='info', description='debug, info, warn or error'
            ),
            SetEnvironmentVariable(
                PROFILE,
                EnvironmentVariable(PROFILE, default_value=shared('config', 'fastdds.xml')),
            ),
            Node(
                package='gcl_ros',
                executable='registrar',
                name=LaunchConfiguration('name'),
                namespace=LaunchConfiguration('namespace'),
                parameters=[
                    LaunchConfiguration('params_file'),
                    {'use_sim_time': LaunchConfiguration('use_sim_time')},
                ],
                remappings=[
                    ('source/points', LaunchConfiguration('source')),
                    ('target/points', LaunchConfiguration('target')),
                    ('source/odometry', LaunchConfiguration('source_odometry')),
                    ('target/odometry', LaunchConfiguration('target_odometry')),
                ],
                arguments=['--ros-args', '--log-level', LaunchConfiguration('log_level')],
                respawn=LaunchConfiguration('respawn'),
                respawn_delay=2.0,
                output='screen',
            ),
        ]
    )

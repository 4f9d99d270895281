"""One registrar: `ros2 launch gcl_ros registrar.launch.py source:=/b/points target:=/a/points`.

The odometry of both is listened to when `motion.odometry` is set in the parameters.
"""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, SetEnvironmentVariable
from launch.substitutions import EnvironmentVariable, LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.substitutions import FindPackageShare


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
            DeclareLaunchArgument('namespace', default_value='', description='of the node'),
            DeclareLaunchArgument(
                'params_file',
                default_value=shared('config', 'registrar.yaml'),
                description='parameters of the node',
            ),
            DeclareLaunchArgument(
                'use_sim_time', default_value='false', description='take the time from /clock'
            ),
            SetEnvironmentVariable(
                'FASTDDS_DEFAULT_PROFILES_FILE',
                EnvironmentVariable(
                    'FASTDDS_DEFAULT_PROFILES_FILE', default_value=shared('config', 'fastdds.xml')
                ),
            ),
            Node(
                package='gcl_ros',
                executable='registrar',
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
                output='screen',
            ),
        ]
    )

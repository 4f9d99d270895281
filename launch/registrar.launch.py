"""One registrar: `ros2 launch gcl_ros registrar.launch.py source:=/b/points target:=/a/points`."""

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
            DeclareLaunchArgument('namespace', default_value=''),
            DeclareLaunchArgument('params_file', default_value=shared('config', 'registrar.yaml')),
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
                parameters=[LaunchConfiguration('params_file')],
                remappings=[
                    ('source/points', LaunchConfiguration('source')),
                    ('target/points', LaunchConfiguration('target')),
                ],
                output='screen',
            ),
        ]
    )

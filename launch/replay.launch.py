"""A bag through a registrar: `ros2 launch gcl_ros replay.launch.py bag:=PATH rviz:=true`."""

from launch import LaunchDescription
from launch.actions import (
    DeclareLaunchArgument,
    IncludeLaunchDescription,
    RegisterEventHandler,
    Shutdown,
)
from launch.conditions import IfCondition
from launch.event_handlers import OnProcessExit
from launch.launch_description_sources import PythonLaunchDescriptionSource
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.substitutions import FindPackageShare


def generate_launch_description() -> LaunchDescription:
    """Declare the arguments, the registrar, the replay and RViz."""
    share = FindPackageShare('gcl_ros')
    replay = Node(
        package='gcl_ros',
        executable='replay',
        arguments=[LaunchConfiguration('bag'), '--rate', LaunchConfiguration('rate')],
        output='screen',
    )
    registrar = PathJoinSubstitution([share, 'launch', 'registrar.launch.py'])
    return LaunchDescription(
        [
            DeclareLaunchArgument('bag', description='folder that `gcl bag` wrote'),
            DeclareLaunchArgument('rate', default_value='0.2', description='bag s a wall s'),
            DeclareLaunchArgument('rviz', default_value='false', description='look at it'),
            IncludeLaunchDescription(
                PythonLaunchDescriptionSource(registrar),
                launch_arguments={
                    'source': '/source/points',
                    'target': '/target/points',
                    'source_odometry': '/source/odometry',
                    'target_odometry': '/target/odometry',
                    'use_sim_time': 'true',  # the bag's, which `replay` publishes
                }.items(),
            ),
            Node(
                package='rviz2',
                executable='rviz2',
                arguments=['-d', PathJoinSubstitution([share, 'rviz', 'registrar.rviz'])],
                condition=IfCondition(LaunchConfiguration('rviz')),
            ),
            replay,
            RegisterEventHandler(OnProcessExit(target_action=replay, on_exit=[Shutdown()])),
        ]
    )

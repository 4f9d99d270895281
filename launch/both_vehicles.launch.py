"""Both vehicles, features between them: each has a describer and a registrar of its own.

`ros2 launch gcl_ros both_vehicles.launch.py a:=vehicle_a b:=vehicle_b` expects the clouds on
`/vehicle_a/points` and `/vehicle_b/points`; with `motion.odometry` the odometry on
`/vehicle_a/odometry` and `/vehicle_b/odometry`. Each registrar takes its own raw points as target
and the other's features as source. Start it with `only:=a` on one vehicle, `only:=b` on the other.
"""

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


def vehicle(own: str, other: str) -> GroupAction:
    """Describer and registrar of one vehicle; `own` and `other` name launch arguments."""
    remappings = [
        ('target/points', ['/', LaunchConfiguration(own), '/points']),
        ('source/points', ['/', LaunchConfiguration(other), '/features']),
        ('target/odometry', ['/', LaunchConfiguration(own), '/odometry']),
        ('source/odometry', ['/', LaunchConfiguration(other), '/odometry']),
    ]
    chosen = PythonExpression(["'", LaunchConfiguration('only'), f"' in ('both', '{own}')"])
    return GroupAction(
        [
            Node(
                package='gcl_ros',
                executable='describer',
                namespace=LaunchConfiguration(own),
                parameters=[LaunchConfiguration('describer_params')],
                output='screen',
            ),
            Node(
                package='gcl_ros',
                executable='registrar',
                namespace=LaunchConfiguration(own),
                parameters=[LaunchConfiguration('registrar_params')],
                remappings=remappings,
                output='screen',
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
                'describer_params',
                default_value=PathJoinSubstitution([config, 'describer.yaml']),
                description='parameters of the describers',
            ),
            SetEnvironmentVariable(
                'FASTDDS_DEFAULT_PROFILES_FILE',
                EnvironmentVariable('FASTDDS_DEFAULT_PROFILES_FILE', default_value=profile),
            ),
            vehicle('a', 'b'),
            vehicle('b', 'a'),
        ]
    )

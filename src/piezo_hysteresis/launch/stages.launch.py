"""Several actuators side by side, each with a loop and a namespace of its own.

ros2 launch piezo_hysteresis stages.launch.py stages:=stage_x,stage_y=zhou_tef

Every stage is a namespace, and may name its preset. All other arguments are those of
loop.launch.py and hold for every stage.
"""

from launch import LaunchDescription
from launch.actions import (
    DeclareLaunchArgument,
    GroupAction,
    IncludeLaunchDescription,
    OpaqueFunction,
)
from launch.launch_description_sources import PythonLaunchDescriptionSource
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.substitutions import FindPackageShare

ARGUMENTS = {
    'stages': ('stage_x,stage_y', 'Namespaces, each with =preset behind it where it has its own.')
}


def _loops(context):
    values = {name: LaunchConfiguration(name).perform(context) for name in ARGUMENTS}
    share = FindPackageShare('piezo_hysteresis')
    loop = PathJoinSubstitution([share, 'launch', 'loop.launch.py'])
    stages = [stage.strip().partition('=') for stage in values['stages'].split(',')]
    names = [name for name, _, _ in stages]
    if not all(names) or len(set(names)) < len(names):
        raise RuntimeError(f'stages:={values["stages"]} must be names, each of them once')
    return [
        GroupAction(
            [
                IncludeLaunchDescription(
                    PythonLaunchDescriptionSource(loop),
                    launch_arguments={
                        'namespace': name,
                        **({'preset': preset} if preset else {}),
                    }.items(),
                )
            ]
        )
        for name, _, preset in stages
    ]


def generate_launch_description():
    return LaunchDescription(
        [
            *(
                DeclareLaunchArgument(name, default_value=default, description=description)
                for name, (default, description) in ARGUMENTS.items()
            ),
            OpaqueFunction(function=_loops),
        ]
    )

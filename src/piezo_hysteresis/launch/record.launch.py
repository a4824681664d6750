"""Record the states, references and markers of one actuator into a bag.

ros2 launch piezo_hysteresis record.launch.py out:=my_bag namespace:=stage_x
"""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

ARGUMENTS = {
    'namespace': ('piezo', 'Namespace of the actuator.'),
    'out': (None, 'Bag folder to create.'),
}


def generate_launch_description():
    values = {name: LaunchConfiguration(name) for name in ARGUMENTS}
    recorder = Node(
        package='piezo_hysteresis',
        executable='recorder',
        namespace=values['namespace'],
        parameters=[{'out': values['out']}],
    )
    return LaunchDescription(
        [
            *(
                DeclareLaunchArgument(name, default_value=default, description=description)
                for name, (default, description) in ARGUMENTS.items()
            ),
            recorder,
        ]
    )

"""The whole loop: simulated actuator, excitation, feedforward, attenuation and who watches.

ros2 launch piezo_hysteresis loop.launch.py preset:=zhou_tef namespace:=stage_x

Several actuators side by side are several launches with different namespaces. With
`simulator:=false` a driver of real hardware takes the simulator's place.
"""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.conditions import IfCondition
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.substitutions import FindPackageShare

ARGUMENTS = {
    'namespace': ('piezo', 'Namespace of all nodes and topics.'),
    'scenario': ('tracking', 'Parameter file of config/scenarios, without .yaml.'),
    'preset': ('fdk_pzba_00030', 'Actuator that is simulated.'),
    'clock': ('real_time', 'real_time, or lock_step as fast as the nodes answer.'),
    'speed_factor': ('1.0', 'How many times real time the real_time clock runs.'),
    'simulator': ('true', 'false where a driver of real hardware runs instead.'),
    'identification': ('true', 'Identify online.'),
    'gap_monitor': ('false', 'Compare with a model.'),
    'model_file': ('', 'Model to invert and to compare with; empty for none.'),
}


def generate_launch_description():
    values = {name: LaunchConfiguration(name) for name in ARGUMENTS}
    file = [values['scenario'], '.yaml']
    share = FindPackageShare('piezo_hysteresis')
    scenario = PathJoinSubstitution([share, 'config', 'scenarios', file])
    simulator = Node(
        package='piezo_sim',
        executable='simulator',
        namespace=values['namespace'],
        condition=IfCondition(values['simulator']),
        parameters=[
            scenario,
            {
                'preset': values['preset'],
                'clock': values['clock'],
                'speed_factor': values['speed_factor'],
            },
        ],
    )
    excitation = Node(
        package='piezo_hysteresis',
        executable='excitation',
        namespace=values['namespace'],
        parameters=[scenario, {'actuator': values['preset']}],
    )
    feedforward = Node(
        package='piezo_hysteresis',
        executable='feedforward',
        namespace=values['namespace'],
        parameters=[scenario, {'model_file': values['model_file']}],
    )
    attenuation = Node(
        package='piezo_hysteresis',
        executable='attenuation',
        namespace=values['namespace'],
        parameters=[scenario],
    )
    identification = Node(
        package='piezo_hysteresis',
        executable='identification',
        namespace=values['namespace'],
        condition=IfCondition(values['identification']),
        parameters=[scenario],
    )
    gap_monitor = Node(
        package='piezo_hysteresis',
        executable='gap_monitor',
        namespace=values['namespace'],
        condition=IfCondition(values['gap_monitor']),
        parameters=[scenario, {'model_file': values['model_file']}],
    )
    return LaunchDescription(
        [
            *(
                DeclareLaunchArgument(name, default_value=default, description=words)
                for name, (default, words) in ARGUMENTS.items()
            ),
            simulator,
            excitation,
            feedforward,
            attenuation,
            identification,
            gap_monitor,
        ]
    )

"""The whole loop: simulated actuator, excitation, feedforward, a correction and who watches.

ros2 launch piezo_hysteresis loop.launch.py preset:=zhou_tef namespace:=stage_x

With `simulator:=false` a driver of real hardware takes the simulator's place. Several actuators
side by side are started by stages.launch.py, or by several launches with different namespaces.
"""

from pathlib import Path

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node
from launch_ros.substitutions import FindPackageShare

from piezo_hysteresis.common.registry import package_of
from piezo_hysteresis.compensation.inverses.reach import usual_reference
from piezo_hysteresis.compensation.operating_limits import operating_limits, rate_of
from piezo_hysteresis.models import ModelFile
from piezo_hysteresis.models.modelfile import is_modal

SWITCHES = ('simulator', 'identification', 'gap_monitor', 'enclaves', 'dashboard')
CHOICES = {
    'clock': ['real_time', 'lock_step'],
    'correction': ['attenuation', 'feedback'],
    **{name: ['true', 'false'] for name in SWITCHES},
}
ARGUMENTS = {
    'namespace': ('piezo', 'Namespace of all nodes and topics.'),
    'scenario': ('tracking', 'Parameter file: a name of config/scenarios, or a path to your own.'),
    'preset': ('fdk_pzba_00030', 'Actuator that is simulated.'),
    'clock': ('real_time', 'real_time, or lock_step as fast as the nodes answer.'),
    'speed_factor': ('1.0', 'Speed of the real_time clock relative to real time.'),
    'simulator': ('true', 'false where a driver of real hardware runs instead.'),
    'correction': ('attenuation', 'Link behind the feedforward: attenuation or feedback.'),
    'identification': ('true', 'Identify online.'),
    'gap_monitor': ('false', 'Compare with a model.'),
    'enclaves': ('false', 'Run each node in its security enclave /NAMESPACE/NODE.'),
    'model_file': ('', 'Model to invert and to compare with; empty for none.'),
    'dashboard': ('false', 'Serve the live page.'),
    'folder': ('~/piezo_hysteresis', 'Where the page records sweeps and discoveries.'),
}


def _plant_of(model_file):
    """Return the parameters that make a controller take its plant from the model, where given."""
    if not model_file:
        return {}
    return {'model_file': model_file, 'plant.gain': 0.0, 'plant.natural_frequency': 0.0}


def _of_model(model_file):
    """Return rate, reference and ranges that a model implies: of all nodes, of two of them."""
    if not model_file:
        return {}, {}, {}
    model = ModelFile.load(model_file)
    limits, (offset, amplitude) = operating_limits(model).limits, usual_reference(model)
    return (
        {'rate': rate_of(model)},
        {'reference.offset': offset, 'reference.amplitude': amplitude},
        {'voltage_range': max(-limits.low, limits.high), 'displacement_range': 2.0 * amplitude},
    )


def _scenario_file(context, name):
    """Return the path of a scenario that is named, or is a path already."""
    if name.endswith('.yaml'):
        found = Path(name)
    else:
        share = Path(FindPackageShare('piezo_hysteresis').perform(context))
        found = share / 'config' / 'scenarios' / f'{name}.yaml'
    if not found.is_file():
        here = ', '.join(sorted(file.stem for file in found.parent.glob('*.yaml')))
        raise RuntimeError(f'scenario:={name} is not there; {found.parent} has: {here or "none"}')
    return str(found)


def _require_one_axis(context, values):
    """Refuse a preset or a model of several axes, whose loop is that of the verb."""
    several = ''
    if values['simulator'] == 'true':
        share = Path(FindPackageShare('piezo_sim').perform(context))
        if (share / 'config' / 'axes' / f'{values["preset"]}.yaml').is_file():
            several = f'preset:={values["preset"]}'
    if values['model_file'] and is_modal(values['model_file']):
        several = f'model_file:={values["model_file"]}'
    if several:
        raise RuntimeError(
            f'{several} is of several axes and this file starts the loop of one; start '
            '`python -m piezo_hysteresis loop --preset PRESET --model MODEL.yaml`'
        )


def _nodes(context):
    values = {name: LaunchConfiguration(name).perform(context) for name in ARGUMENTS}
    _require_one_axis(context, values)
    scenario = _scenario_file(context, values['scenario'])
    namespace = values['namespace'].strip('/')
    secured = values['enclaves'] == 'true'
    on = {name for name in SWITCHES if values[name] == 'true'} | {values['correction']}
    model = {'model_file': values['model_file']}
    page = {'folder': values['folder']}
    rate, reference, ranges = _of_model(values['model_file'])
    simulator = {
        'preset': values['preset'],
        'clock': values['clock'],
        'speed_factor': float(values['speed_factor']),
        # In lock-step the first tick waits for the readers of the states.
        'wait_for': 2 + len(on & {'identification', 'gap_monitor'}),
    }

    def of(fixed, implied=None):
        # what a model implies replaces values of the suite, not those of a file of one's own
        implied = {**rate, **(implied or {})}
        if values['scenario'].endswith('.yaml'):
            return [implied, scenario, fixed]
        return [scenario, {**implied, **fixed}]

    plant = _plant_of(values['model_file'])
    parameters = {
        'simulator': of(simulator),
        'excitation': of({'actuator': values['preset'], **page}, reference),
        'feedforward': of(model),
        'attenuation': of(plant),
        'feedback': of(plant),
        'identification': of({}, ranges),
        'gap_monitor': of(model),
        'dashboard': [page],
    }
    chosen = on | {'excitation', 'feedforward'}
    return [
        Node(
            package=package_of(name),
            executable=name,
            namespace=namespace,
            parameters=given,
            output='screen' if name == 'dashboard' else 'log',
            ros_arguments=['--enclave', f'/{namespace}/{name}'] if secured else [],
        )
        for name, given in parameters.items()
        if name in chosen
    ]


def generate_launch_description():
    return LaunchDescription(
        [
            *(
                DeclareLaunchArgument(
                    name, default_value=default, description=description, choices=CHOICES.get(name)
                )
                for name, (default, description) in ARGUMENTS.items()
            ),
            OpaqueFunction(function=_nodes),
        ]
    )

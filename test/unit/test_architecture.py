"""Imports may only point one way; found by reading the source, nothing is imported."""

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2] / 'src'
CORE = ROOT / 'piezo_hysteresis' / 'piezo_hysteresis'
# Each room may import itself and the rooms named here.
NEUTRAL = {'numerics', 'records', 'waveforms', 'blocks'}
ALLOWED = {
    'numerics': set(),
    'records': {'numerics', 'waveforms'},
    'waveforms': {'numerics', 'records'},
    'blocks': {'numerics'},
    'models': NEUTRAL,
    'identification': NEUTRAL | {'models'},
    'compensation': NEUTRAL | {'models', 'identification'},
    'discovery': NEUTRAL | {'models', 'identification', 'compensation'},
    'reporting': NEUTRAL | {'models', 'identification', 'compensation', 'discovery'},
    'dashboard': NEUTRAL | {'models', 'reporting'},
    'batch': NEUTRAL | {'models', 'identification', 'discovery', 'reporting'},
    'cli': NEUTRAL
    | {'models', 'identification', 'compensation', 'discovery', 'reporting', 'batch'},
    'nodes': NEUTRAL
    | {'models', 'identification', 'compensation', 'discovery', 'reporting', 'cli', 'dashboard'},
}
ROS = {
    'rclpy',
    'rcl_interfaces',
    'std_msgs',
    'std_srvs',
    'lifecycle_msgs',
    'diagnostic_msgs',
    'builtin_interfaces',
    'piezo_interfaces',
    'piezo_ros_common',
}


def imported(path):
    """Answer the dotted names that a file imports, those within functions included."""
    for node in ast.walk(ast.parse(path.read_text(encoding='utf-8'))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f'{path}: relative import'
            yield node.module
            yield from (f'{node.module}.{alias.name}' for alias in node.names)


def files_of(folder):
    return sorted(folder.rglob('*.py'))


def test_the_rooms_are_those_of_the_design():
    rooms = {path.name for path in CORE.iterdir() if (path / '__init__.py').exists()}
    assert rooms == set(ALLOWED)


@pytest.mark.parametrize('room', ALLOWED)
def test_imports_between_rooms_point_one_way(room):
    wrong = [
        f'{path.relative_to(ROOT)}: {name}'
        for path in files_of(CORE / room)
        for name in imported(path)
        if name.startswith('piezo_hysteresis.')
        and name.split('.')[1] in ALLOWED
        and name.split('.')[1] not in ALLOWED[room] | {room}
    ]
    assert wrong == []


def test_only_nodes_know_ros():
    wrong = [
        f'{path.relative_to(ROOT)}: {name}'
        for path in files_of(CORE)
        if (CORE / 'nodes') not in path.parents
        for name in imported(path)
        if name.split('.')[0] in ROS
    ]
    assert wrong == []


def test_the_core_never_imports_the_simulator():
    wrong = [
        f'{path.relative_to(ROOT)}: {name}'
        for path in files_of(CORE)
        for name in imported(path)
        if name.split('.')[0] == 'piezo_sim'
    ]
    assert wrong == []


def test_the_simulator_imports_only_the_neutral_rooms():
    allowed = ('piezo_hysteresis.records', 'piezo_hysteresis.waveforms')
    files = files_of(ROOT / 'piezo_sim' / 'piezo_sim')
    assert files
    wrong = [
        f'{path.relative_to(ROOT)}: {name}'
        for path in files
        for name in imported(path)
        if name.split('.')[0] == 'piezo_hysteresis'
        and not any(name == each or name.startswith(f'{each}.') for each in allowed)
    ]
    assert wrong == []


def test_the_simulator_knows_ros_only_in_its_nodes():
    folder = ROOT / 'piezo_sim' / 'piezo_sim'
    wrong = [
        f'{path.relative_to(ROOT)}: {name}'
        for path in files_of(folder)
        if (folder / 'nodes') not in path.parents
        for name in imported(path)
        if name.split('.')[0] in ROS
    ]
    assert wrong == []


# What raises where numbers are not finite is called through `numerics.linalg`, or within its
# `failing_as`, as the design of the H-infinity controller is.
SAFE = ('norm', 'LinAlgError')
UNDER_FAILING_AS = ('hinf.py', 'hinf_synthesis.py')


def test_linear_algebra_that_can_fail_is_called_in_one_place():
    wrong = []
    for path in files_of(CORE):
        if (CORE / 'numerics') in path.parents or path.name in UNDER_FAILING_AS:
            continue
        tree = ast.parse(path.read_text(encoding='utf-8'))
        names = [
            ast.unparse(node)
            for node in ast.walk(tree)
            if isinstance(node, ast.Attribute)
            and ast.unparse(node.value) in ('np.linalg', 'linalg', 'scipy.linalg')
            and node.attr not in SAFE
        ]
        wrong += [f'{path.relative_to(CORE)}: {name}' for name in names]
        wrong += [
            f'{path.relative_to(CORE)}: {name}'
            for name in imported(path)
            if name.startswith(('numpy.linalg', 'scipy.linalg'))
        ]
    assert wrong == []


def test_the_compiling_of_kernels_knows_nothing_of_the_rest():
    files = files_of(ROOT / 'piezo_kernels' / 'piezo_kernels')
    assert files
    wrong = [
        f'{path.relative_to(ROOT)}: {name}'
        for path in files
        for name in imported(path)
        if name.split('.')[0] in {*ROS, 'piezo_sim', 'piezo_hysteresis'}
    ]
    assert wrong == []

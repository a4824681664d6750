"""Imports may only point one way; found by reading the source, nothing is imported."""

from __future__ import annotations

import ast
from graphlib import TopologicalSorter
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).parents[2] / 'src'
CORE = ROOT / 'piezo_hysteresis' / 'piezo_hysteresis'
# Each room imports itself and the rooms named here, all of them: an arrow that nothing uses any
# more goes from this table.
ARROWS = {
    'common': '',
    'kernels': '',
    'ros': 'common kernels',
    'numerics': '',
    'records': 'common',
    'waveforms': 'common numerics',
    'blocks': 'common numerics',
    'models': 'blocks common kernels numerics records',
    'identification': 'blocks common kernels models numerics records',
    'axes': 'blocks common identification models numerics records',
    'compensation': 'axes blocks common models numerics waveforms',
    'experiments': 'common models records waveforms',
    'discovery': 'blocks common experiments identification models numerics records',
    'investigation': 'common discovery experiments identification models numerics records '
    'reporting',
    'reporting': 'axes blocks common compensation discovery identification models numerics '
    'records',
    'dashboard': 'common models reporting',
    'parameters': 'common compensation waveforms',
    'runtime': 'common compensation identification models numerics records waveforms',
    'nodes': 'blocks common compensation dashboard discovery drivers experiments identification '
    'investigation models parameters records ros runtime waveforms',
    'drivers': 'common compensation models numerics records runtime waveforms',
    'export': 'blocks common compensation models parameters waveforms',
    'interface': 'axes common compensation discovery experiments export identification '
    'investigation models records reporting waveforms',
    'batch': 'common interface records reporting',
    'cli': 'axes batch common compensation discovery drivers experiments identification '
    'interface investigation models nodes parameters records reporting ros runtime waveforms',
}
# Rooms within `compensation`: what they share imports none of them.
WITHIN_COMPENSATION: dict[str, set[str]] = {
    'inverses': set(),
    'harmonics': set(),
    'feedback': set(),
    'coupled': set(),
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
}


def imported(path: Any) -> Any:
    """Return the dotted names that a file imports, those within functions included.

    What only a checker of types imports is no arrow.
    """
    tree = ast.parse(path.read_text(encoding='utf-8'))
    for block in ast.walk(tree):
        if isinstance(block, ast.If) and ast.unparse(block.test) == 'TYPE_CHECKING':
            block.body = []
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f'{path}: relative import'
            yield node.module
            yield from (f'{node.module}.{alias.name}' for alias in node.names)


def files_of(folder: Any) -> Any:
    return sorted(folder.rglob('*.py'))


def test_the_rooms_are_those_of_the_design() -> None:
    rooms = {path.name for path in CORE.iterdir() if (path / '__init__.py').exists()}
    assert rooms == set(ARROWS)


@pytest.mark.parametrize('room', ARROWS)
def test_imports_between_rooms_are_those_of_the_table(room: Any) -> None:
    found: dict[str, list[str]] = {}
    for path in files_of(CORE / room):
        for name in imported(path):
            top, _, rest = name.partition('.')
            other = rest.split('.')[0]
            if top == 'piezo_hysteresis' and other in ARROWS and other != room:
                found.setdefault(other, []).append(str(path.relative_to(ROOT)))
    expected = ARROWS[room].split()
    assert {k: v for k, v in found.items() if k not in expected} == {}
    assert sorted(found) == expected


def test_arrows_between_rooms_point_one_way() -> None:
    TopologicalSorter({room: others.split() for room, others in ARROWS.items()}).prepare()


@pytest.mark.parametrize('room', WITHIN_COMPENSATION)
def test_the_rooms_of_compensation_know_only_what_they_share(room: Any) -> None:
    folder = CORE / 'compensation'
    wrong = [
        f'{path.relative_to(ROOT)}: {name}'
        for path in files_of(folder / room)
        for name in imported(path)
        for other in WITHIN_COMPENSATION
        if other not in (room, *WITHIN_COMPENSATION[room])
        and name.startswith(f'piezo_hysteresis.compensation.{other}')
    ]
    assert wrong == []


NEEDING_ROS = ('piezo_hysteresis.nodes', 'piezo_hysteresis.ros')


def knows_ros(name: str) -> bool:
    return name.split('.')[0] in ROS or name.startswith(NEEDING_ROS)


def needing_ros(path: Any) -> Any:
    """Return the names that a file imports within ``with ros_needed():``, inside a function."""
    for function in ast.walk(ast.parse(path.read_text(encoding='utf-8'))):
        if not isinstance(function, ast.FunctionDef):
            continue
        for node in ast.walk(function):
            if isinstance(node, ast.With) and ast.unparse(node.items[0]) == 'ros_needed()':
                for each in node.body:
                    assert isinstance(each, ast.ImportFrom), f'{path}: only imports belong there'
                    yield from (each.module, *(f'{each.module}.{a.name}' for a in each.names))


def test_verbs_import_nodes_only_where_a_missing_ros_is_reported() -> None:
    used = []
    for path in files_of(CORE / 'cli'):
        outside = list(imported(path))
        for name in needing_ros(path):
            outside.remove(name)
            used.append(name)
        wrong = [n for n in outside if n.startswith(NEEDING_ROS)]
        assert wrong == [], path
    assert 'piezo_hysteresis.nodes.live' in used


@pytest.mark.component
def test_only_nodes_know_ros() -> None:
    wrong = []
    for path in files_of(CORE):
        if path.relative_to(CORE).parts[0] in ('nodes', 'ros'):
            continue
        names = list(imported(path))
        if (CORE / 'cli') in path.parents:
            for name in needing_ros(path):
                names.remove(name)
        wrong += [f'{path.relative_to(ROOT)}: {name}' for name in names if knows_ros(name)]
    assert wrong == []


# Imports by a name that is made up at run time, which no arrow shows: each stays in its own room.
BY_NAME = {
    '__init__.py': 'names of the whole, loaded when they are used',
    'blocks/__init__.py': 'every file of the room holds blocks',
    'common/results.py': 'plots and reports of results, loaded when a result is shown',
    'models/model_actions.py': 'inverse and export, loaded when a model is asked for them',
    'common/interrupts.py': 'the command line that a program runs, named by its caller',
    'cli/main.py': 'only the verb that is asked for is loaded',
    'ros/starting.py': 'only the node that is asked for is loaded',
    'discovery/__init__.py': 'names of the room, loaded when they are used',
    'nodes/recording/listeners.py': 'messages of any package, by the name of their type',
}


@pytest.mark.component
def test_nothing_is_imported_by_name_round_the_arrows() -> None:
    users = [
        str(path.relative_to(CORE))
        for path in files_of(CORE)
        if any(
            (
                isinstance(node, ast.Call)
                and ast.unparse(node.func) in ('importlib.import_module', '__import__')
            )
            or (
                (isinstance(node, ast.ImportFrom) and node.module == 'importlib')
                and any(alias.name == 'import_module' for alias in node.names)
            )
            for node in ast.walk(ast.parse(path.read_text(encoding='utf-8')))
        )
    ]
    assert sorted(users) == sorted(BY_NAME)


@pytest.mark.component
def test_nothing_imports_the_simulator() -> None:
    wrong = [
        f'{path.relative_to(ROOT)}: {name}'
        for path in files_of(CORE)
        for name in imported(path)
        if name.split('.')[0] == 'piezo_sim'
    ]
    assert wrong == []


def test_the_simulator_imports_only_the_neutral_rooms() -> None:
    rooms = ('common', 'kernels', 'ros', 'records', 'waveforms')
    allowed = tuple(f'piezo_hysteresis.{room}' for room in rooms)
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


def test_the_simulator_knows_ros_only_in_its_nodes() -> None:
    folder = ROOT / 'piezo_sim' / 'piezo_sim'
    wrong = [
        f'{path.relative_to(ROOT)}: {name}'
        for path in files_of(folder)
        if (folder / 'nodes') not in path.parents
        for name in imported(path)
        if knows_ros(name)
    ]
    assert wrong == []


# What raises where numbers are not finite is called through `numerics.linalg`, or within its
# `failing_as`, as the design of the H-infinity controller is.
SAFE = ('norm', 'LinAlgError')
UNDER_FAILING_AS = (
    'hinf.py', 'cross_talk.py', 'frequency_response.py', 'modal_start.py', 'modal_fit.py',
    'modal_model.py', 'axes_tracking.py', 'decoupling.py', 'matrix_attenuation.py', 'mode_talk.py',
)  # fmt: skip


@pytest.mark.component
def test_linear_algebra_that_can_fail_is_called_in_one_place() -> None:
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

"""A sweep over live processes into a bag, and the bag back into the identification node."""

from __future__ import annotations

import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticStatus
from listening import Listener
from live_nodes import LiveNodes
from rclpy.action import ActionClient
from rosgraph_msgs.msg import Clock

from piezo_hysteresis.identification import identify
from piezo_hysteresis.identification.per_frequency import identify_per_frequency
from piezo_hysteresis.models import ModelFile, named
from piezo_hysteresis.records import Record, read_bag
from piezo_hysteresis.ros.processes import NodeProcess
from piezo_interfaces.action import RunSweep
from piezo_interfaces.msg import ActuatorState, LoopStatus, ModelEstimate
from piezo_interfaces.srv import SaveModel

pytestmark = pytest.mark.ros

SECONDS = 1.0
GOAL: dict[str, Any] = {
    'frequencies': [7.0, 20.0],
    'amplitudes': [1.0],
    'seconds': SECONDS,
    'warm_up': 0.1,
}
IDENTIFICATION = {'publish_every': round(2000 * SECONDS)}


def run_sweep(listener: Listener, goal: dict[str, Any]) -> None:
    client = ActionClient(listener.node, RunSweep, 'run_sweep')
    listener.until(client.server_is_ready)
    listener.found_by('excitation')
    accepted = client.send_goal_async(RunSweep.Goal(**goal))
    listener.until(accepted.done)
    finished = accepted.result().get_result_async()
    listener.until(finished.done)
    assert finished.result().result.success, finished.result().result.message
    client.destroy()


def recorded(listener: Listener, recorder: str, count: int) -> None:
    """Wait until a recorder says that it has written `count` messages."""
    status = listener.received[f'{recorder}/status']
    listener.until(lambda: any(message.sample >= count for message in status))


@pytest.fixture(scope='module')
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp('bags')


@pytest.fixture(scope='module')
def online(
    shared_processes: LiveNodes, shared_listener: Listener, folder: Path
) -> list[ModelEstimate]:
    """Run the sweep with an identification beside it; return what that published.

    Leaves the bag ``sweep`` closed, and the bag ``killed`` as a SIGKILL left it.
    """
    listener, processes = shared_listener, shared_processes
    for name in ('recorder', 'victim'):
        listener.listen(LoopStatus, f'{name}/status', latched=True)
    states = listener.listen(ActuatorState, 'actuator/state')
    estimates = listener.listen(ModelEstimate, 'model/estimate', latched=True)
    processes.start('piezo_sim', 'simulator', {'clock': 'lock_step', 'wait_for': 5, 'seed': 5})
    processes.start(
        'piezo_hysteresis', 'excitation', {'actuator': 'bender', 'marker_listeners': 3}
    )
    processes.start(
        'piezo_hysteresis', 'identification', {**IDENTIFICATION, 'model_folder': str(folder)}
    )
    closed = processes.start('piezo_hysteresis', 'recorder', {'out': str(folder / 'sweep')})
    killed = processes.start(
        'piezo_hysteresis', 'recorder', {'out': str(folder / 'killed')}, name='victim'
    )
    for topic in ('actuator/state', 'record/marker', 'reference'):
        listener.until(
            lambda name=topic: (
                {'recorder', 'victim'}
                <= {i.node_name for i in listener.node.get_subscriptions_info_by_topic(f'/{name}')}
            )
        )
    run_sweep(listener, GOAL)
    listener.until(lambda: len(states) >= 2 * (1000 * SECONDS + 100))
    recorded(listener, 'victim', len(states) + 4)
    killed.signal(signal.SIGKILL)
    processes.retire(killed)
    recorded(listener, 'recorder', len(states) + 4)
    listener.until(lambda: estimates)
    closed.stop()
    processes.retire(closed)
    return estimates


@pytest.fixture(scope='module')
def replayed(folder: Path) -> Iterator[tuple[LiveNodes, Listener, list[ModelEstimate]]]:
    """Serve an identification in a domain that nobody was killed in: the dead are known long."""
    with LiveNodes() as processes:
        listener = Listener(processes)
        estimates = listener.listen(ModelEstimate, 'model/estimate', latched=True)
        processes.start(
            'piezo_hysteresis', 'identification', {**IDENTIFICATION, 'model_folder': str(folder)}
        )
        yield processes, listener, estimates
        listener.close()


def equal(a: list[Record], b: list[Record]) -> None:
    assert [record.name for record in a] == [record.name for record in b]
    for one, other in zip(a, b, strict=True):
        np.testing.assert_array_equal(one.voltage, other.voltage)
        np.testing.assert_array_equal(one.displacement, other.displacement)


def test_a_live_sweep_becomes_records(
    online: list[ModelEstimate], folder: Path, shared_listener: Listener
) -> None:
    records = read_bag(folder / 'sweep')
    assert [record.name for record in records] == ['sine_7Hz_1V', 'sine_20Hz_1V']
    assert {record.info.actuator for record in records} == {'bender'}
    states = {state.sample: state for state in shared_listener.received['actuator/state']}
    for k, record in enumerate(records):
        first = k * round(1000 * SECONDS + 100)
        rows = [states[first + i] for i in range(round(1000 * SECONDS))]
        np.testing.assert_array_equal(record.voltage, [row.voltage for row in rows])
        np.testing.assert_array_equal(record.displacement, [row.displacement for row in rows])
        assert record.info.warm_up == 0.1


def test_a_killed_recorder_leaves_what_was_flushed(
    online: list[ModelEstimate], folder: Path
) -> None:
    equal(read_bag(folder / 'killed'), read_bag(folder / 'sweep'))


def offline(folder: Path, method: str = 'rls', model: str = 'extended') -> dict[str, float]:
    records = read_bag(folder / 'sweep')  # the node trusts the clock of what it hears
    return identify(records, named(model), method=method, sampling_offset=False).values


def agree(estimate: ModelEstimate, expected: dict[str, float]) -> None:
    found = dict(zip(estimate.names, estimate.values, strict=True))
    assert found
    for name, value in found.items():
        assert value == pytest.approx(expected[name], rel=1e-12, abs=1e-300), name


def test_online_and_offline_identification_agree(
    online: list[ModelEstimate], folder: Path
) -> None:
    (estimate,) = online
    # the verb takes the offset from free runs over the records, which a node does not keep
    assert dict(zip(estimate.names, estimate.values, strict=True))['offset'] == 0.0
    agree(estimate, {**offline(folder), 'offset': 0.0})
    assert estimate.method == 'rls'
    assert estimate.model == 'extended'
    assert estimate.one_step_rms > 0.0
    assert estimate.free_run_rms > 0.0


def play(processes: LiveNodes, bag: Path, **settings: Any) -> NodeProcess:
    return processes.start(
        'piezo_hysteresis', 'player', {'bag': str(bag), 'lock_step': True, **settings}
    )


@pytest.mark.parametrize(
    ('method', 'model'), [('rls_ud', 'classical'), ('pi_bank', 'prandtl_ishlinskii')]
)
def test_a_bag_played_in_lock_step_gives_the_numbers_of_identify(
    online: list[ModelEstimate],
    replayed: tuple[LiveNodes, Listener, list[ModelEstimate]],
    folder: Path,
    method: str,
    model: str,
) -> None:
    processes, listener, estimates = replayed
    records = read_bag(folder / 'sweep')
    for name, value in {
        'voltage_range': max(float(np.max(np.abs(r.voltage))) for r in records),
        'displacement_range': max(float(np.ptp(r.displacement)) for r in records) / 2,
        'method': method,
    }.items():
        assert listener.set_one('identification', name, value) == ''
    before = len(estimates)
    node = play(processes, folder / 'sweep')
    assert processes.wait_for(node, 60.0) == 0
    listener.until(lambda: len(estimates) > before)
    assert len(estimates) == before + 1
    agree(estimates[-1], offline(folder, method, model))
    assert estimates[-1].method == method
    assert estimates[-1].free_run_rms == estimates[-1].one_step_rms


def test_an_estimate_is_saved_inside_the_folder_only(
    online: list[ModelEstimate],
    replayed: tuple[LiveNodes, Listener, list[ModelEstimate]],
    folder: Path,
) -> None:
    _, listener, estimates = replayed

    def save(path: str) -> Any:
        request = SaveModel.Request(path=path)
        return listener.call(SaveModel, 'identification/save', request)

    answer = save('model.yaml')
    assert answer.success, answer.message
    saved = ModelFile.load(folder / 'model.yaml')
    estimate = estimates[-1]
    for name, value in zip(estimate.names, estimate.values, strict=True):
        assert saved.values[name] == pytest.approx(value, rel=1e-12, abs=1e-300)
    before = sorted(folder.parent.rglob('*'))
    for path in ('../escaped.yaml', '/escaped.yaml', '', '.'):
        answer = save(path)
        assert not answer.success
        assert answer.message
    assert sorted(folder.parent.rglob('*')) == before


def test_a_played_sweep_gives_the_models_of_identify_per_frequency(
    online: list[ModelEstimate],
    replayed: tuple[LiveNodes, Listener, list[ModelEstimate]],
    folder: Path,
) -> None:
    """Both have the harmonic of 20 Hz, and no model of 7 Hz: RLS finds a negative beta there."""
    processes, listener, _ = replayed
    for name, value in {'method': 'rls', 'per_frequency': True}.items():
        assert listener.set_one('identification', name, value) == ''
    assert processes.wait_for(play(processes, folder / 'sweep'), 60.0) == 0
    request = SaveModel.Request(path='drives.yaml')
    answer = listener.call(SaveModel, 'identification/save', request)
    assert answer.success, answer.message
    live = ModelFile.load(folder / 'drives.yaml').schedule
    assert listener.set_one('identification', 'per_frequency', False) == ''
    records = read_bag(folder / 'sweep')
    found = identify_per_frequency(records, 'extended', method='rls').model_file().schedule
    assert live is not None
    assert found is not None
    names = [(point.name, point.order, point.model.model.name) for point in live.points]
    assert names == [('20 Hz, 1 V', 3, 'enhanced3')]
    for one, other in zip(live.points, found.points, strict=True):
        assert (one.name, one.order) == (other.name, other.order)
        assert one.travel == pytest.approx(other.travel, rel=1e-9)
        assert one.model.model.block_names == other.model.model.block_names
        for name, number in one.model.values.items():
            if name != 'offset':  # the verb takes it from free runs, which a node does not keep
                expected = other.model.values[name]
                assert number == pytest.approx(expected, rel=1e-12, abs=1e-300), name


def test_the_player_reports_its_progress_and_the_node_it_waits_for(
    online: list[ModelEstimate], folder: Path, processes: LiveNodes, listener: Listener
) -> None:
    health = listener.watch_health()
    ok, warn, error = DiagnosticStatus.OK, DiagnosticStatus.WARN, DiagnosticStatus.ERROR
    with LiveNodes(processes.domain) as others:  # that this one dies fails nobody
        node = play(others, folder / 'sweep', loop=True, wait=300.0)
        listener.says(health, 'player', warn, 'waits for a listener')
        receiver = processes.start('piezo_hysteresis', 'identification')
        # The first report of a player that plays can precede its first message.
        listener.until(lambda: int(listener.says(health, 'player', ok, 'plays')['messages']) > 0)
        receiver.signal(signal.SIGSTOP)
        listener.says(health, 'player', warn, 'identification has not confirmed')
        receiver.signal(signal.SIGCONT)
        listener.says(health, 'player', ok, 'plays')
        receiver.signal(signal.SIGSTOP)
        assert listener.set_one('player', 'wait', 0.1) == ''
        listener.says(health, 'player', error, 'did not take')
        receiver.signal(signal.SIGCONT)
        assert node.wait(60.0) == 2
    play(processes, folder / 'sweep', lock_step=False, rate_factor=1e6, loop=True)
    assert int(listener.says(health, 'player', warn, 'come too late')['late']) > 0


def went_back(states: list[ActuatorState]) -> Any:
    return np.diff([state.sample for state in states]) < 0


def test_the_verb_plays_at_a_rate_in_a_loop_with_a_clock(
    online: list[ModelEstimate], folder: Path, processes: LiveNodes, listener: Listener
) -> None:
    states = listener.listen(ActuatorState, 'actuator/state')
    clock = listener.listen(Clock, '/clock')
    words = ['play', str(folder / 'sweep'), '--rate', '2', '--loop', '--clock']
    verb = subprocess.Popen(
        [sys.executable, '-m', 'piezo_hysteresis', *words],
        env=processes.environment,
        stderr=subprocess.PIPE,
        start_new_session=True,
    )
    try:
        listener.until(lambda: np.any(went_back(states)) and clock)
        verb.send_signal(signal.SIGINT)
        _, printed = verb.communicate(timeout=60.0)
    finally:
        verb.kill()
    assert verb.returncode == 0
    assert b'Traceback' not in printed
    length = round(2 * (1000 * SECONDS + 100))
    steps = np.diff([state.sample for state in states]) % length
    # a busy machine may lose some ticks, but not their order
    assert np.mean(steps == 1) > 0.9
    times = [each.clock.sec * 10**9 + each.clock.nanosec for each in clock]
    assert times[0] > 0
    assert np.count_nonzero(np.diff(times) < 0) <= np.count_nonzero(went_back(states)) + 1


def test_playing_what_cannot_be_played_is_one_line(processes: LiveNodes, tmp_path: Path) -> None:
    for settings, words in (
        ({}, 'give the bag'),
        ({'bag': str(tmp_path / 'nothing')}, 'does not exist'),
    ):
        node = processes.start('piezo_hysteresis', 'player', settings)
        assert node.wait(30.0) == 2
        text = node.log.read_text()
        assert words in text
        assert len(text.strip().splitlines()) == 1
        processes.retire(node)

"""Sweeps in a controller, against the simulated ones: GCS 2 by TCP and serial, and NV200."""

from __future__ import annotations

import json
import socket
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from piezo_hysteresis.cli.main import main
from piezo_hysteresis.compensation.link import Limits
from piezo_hysteresis.drivers import DriverError, Measurement, driver_sweep, open_controller, sweep
from piezo_hysteresis.drivers.controller import UNLIMITED
from piezo_hysteresis.drivers.gcs import GcsConnection, GcsController
from piezo_hysteresis.drivers.tracking import Learning
from piezo_hysteresis.drivers.wires import TcpWire
from piezo_hysteresis.drivers.worker import ControllerSweep, ControllerThread, SweepProgress
from piezo_hysteresis.identification.identify import identify
from piezo_hysteresis.models import ModelFile, named
from piezo_hysteresis.records import RecordInfo, load
from piezo_hysteresis.waveforms import Sine
from piezo_sim.gcs.controller import OUTPUT, SimulatedController
from piezo_sim.gcs.language import Language
from piezo_sim.gcs.nv200 import Nv200Language
from piezo_sim.gcs.server import FAULTS, Fault, GcsServer, PtyServer
from piezo_sim.plant import Plant
from piezo_sim.sweep import grid as simulated_grid
from piezo_sim.sweep import simulate

PRESET, RATE = 'fdk_pzba_00030', 20_000.0
QUIET = {'effects.noise': True, 'sensor.noise_rms': 5e-8}


KINDS = ('tcp', 'serial', 'nv200')


@contextmanager
def running(server: Any, *words: Any) -> Iterator[None]:
    thread = threading.Thread(target=server.serve_forever, args=words, daemon=True)
    thread.start()
    try:
        yield
    finally:
        server.shutdown()
        thread.join()


@contextmanager
def serving(speed: float = np.inf, fault: Fault | None = None) -> Iterator[GcsServer]:
    server = GcsServer(SimulatedController(Plant.from_preset(PRESET, RATE), speed), 0, fault)
    with running(server, 0.01):
        yield server
    server.server_close()


@contextmanager
def served(
    kind: str, speed: float = np.inf, fault: Fault | None = None
) -> Iterator[tuple[str, SimulatedController]]:
    """Yield the address of a simulated controller, and the controller."""
    if kind == 'tcp':
        with serving(speed, fault) as server:
            yield f'gcs://127.0.0.1:{server.server_address[1]}', server.controller
        return
    controller = SimulatedController(Plant.from_preset(PRESET, RATE), speed)
    if kind == 'nv200_telnet':
        server = GcsServer(controller, 0, fault, Nv200Language(controller))
        with running(server, 0.01):
            yield f'nv200://127.0.0.1:{server.server_address[1]}', controller
        server.server_close()
        return
    language = (Nv200Language if kind == 'nv200' else Language)(controller)
    pty = PtyServer(controller, language, fault)
    with running(pty):
        yield f'{"nv200" if kind == "nv200" else "gcs"}://{pty.path}', controller


def connected(
    server: GcsServer, limits: Limits = UNLIMITED, timeout: float = 5.0
) -> GcsController:
    wire = TcpWire('127.0.0.1', server.server_address[1], timeout)
    return GcsController(GcsConnection(wire), limits)


@pytest.fixture
def server() -> Iterator[GcsServer]:
    with serving() as made:
        yield made


def test_it_reports_its_identity_and_moves_nothing(server: GcsServer) -> None:
    server.controller.set_voltage(1.5)
    before = server.controller.voltage
    made = connected(server)
    assert made.identity.rate == RATE
    assert made.identity.firmware == '1.0.0'
    assert (made.limits.low, made.limits.high) == (-5.0, 5.0)
    assert server.controller.voltage in (before, 1.5)
    assert not made.is_running
    made.disconnect()


def test_a_wave_comes_back_as_the_plant_answers_it(server: GcsServer) -> None:
    wave = np.concatenate([np.zeros(50), np.sin(np.arange(1000) * 2 * np.pi / 1000), np.zeros(50)])
    with connected(server) as made:
        made.open_loop()
        played = made.play(wave)
    assert played.dt == pytest.approx(1.0 / RATE)
    np.testing.assert_allclose(played.voltage, wave, rtol=0, atol=2e-9)
    assert np.ptp(played.displacement) > 5e-5
    assert server.controller.voltage == 0.0


def test_a_slow_controller_has_the_timeout_for_each_line_of_a_table(server: GcsServer) -> None:
    usual = server.language.answer

    def slowly(line: str) -> str | None:
        time.sleep(0.004)
        return usual(line)

    server.language.answer = slowly  # type: ignore[method-assign]
    with closing(GcsConnection(TcpWire('127.0.0.1', server.server_address[1], 0.5))) as line:
        began = time.monotonic()
        GcsController(line).load(np.zeros(30_000), 1)
        assert time.monotonic() - began > 1.0  # twice the timeout


def test_a_command_waits_for_no_acknowledgement(server: GcsServer) -> None:
    seconds: dict[str, list[float]] = {'VOL? 1': [], 'SVA 1 0': []}
    with closing(GcsConnection(TcpWire('127.0.0.1', server.server_address[1]))) as line:
        for _ in range(15):
            for text, act in (('VOL? 1', line.ask), ('SVA 1 0', line.command)):
                began = time.perf_counter()
                act(text)
                seconds[text].append(time.perf_counter() - began)
    assert np.median(seconds['SVA 1 0']) < 20.0 * np.median(seconds['VOL? 1'])


@pytest.mark.parametrize('kind', KINDS)
def test_every_driver_connects_measures_and_comes_to_rest(kind: str) -> None:
    with served(kind) as (address, controller):
        controller.set_voltage(1.5)
        with open_controller(address, low=-2.0, high=2.0) as made:
            assert controller.voltage in (0.0, 1.5)
            assert made.identity.rate == RATE
            made.open_loop()
            assert made.voltage == 0.0
            first, second = sweep(made, [20.0, 50.0], [1.0], 0.2, actuator='bender')
            with pytest.raises(DriverError, match=r'leaves the range -2 \.\. 2 V'):
                sweep(made, [20.0], [2.5], 0.2)
            assert made.about()['limits']['high'] == 2.0
        assert abs(voltage_of(controller)) < 1e-5
    assert first.rate == second.rate == RATE / made.divider_for(0.5)
    np.testing.assert_allclose(np.abs(first.voltage).max(), 1.0, rtol=0.01)
    assert np.ptp(first.displacement) > 5e-5
    assert second.info.actuator == 'bender'


@pytest.mark.parametrize('kind', KINDS)
def test_an_axis_that_is_not_there_leaves_no_connection(kind: str) -> None:
    with served(kind) as (address, _):
        with pytest.raises(DriverError, match='there is no axis 7; it has 1'):
            open_controller(address, '7')
        open_controller(address).disconnect()  # one client at a time


def test_a_verb_measures_by_a_serial_port(tmp_path: Path) -> None:
    words = [
        '--frequencies',
        '20',
        '--amplitudes',
        '0.5',
        '--seconds',
        '0.2',
        '--range',
        '-1',
        '1',
    ]
    with served('nv200') as (address, _):
        bag = tmp_path / 'bag'
        assert main(['sweep', '--on', address, *words, '--out', str(bag)]) == 0
    (record,) = load(bag)
    about = yaml.safe_load((bag / 'controller.yaml').read_text())
    assert about['rate'] == record.rate
    assert 'low-pass of the position at 1000 Hz' in about['filters']


@pytest.mark.parametrize(
    ('words', 'sentence'),
    [('--plant model.yaml --rounds 3', '--rounds: of a controller, not used with --plant'),
     ('--on gcs://x --rate 500 --noise 1e-9', '--noise, --rate: of a study, not used with --on')],
)  # fmt: skip
def test_words_that_would_be_ignored_are_refused(
    words: str, sentence: str, capsys: Any, tmp_path: Path
) -> None:
    needed = ['--model', 'm.yaml', '--reference', 'sine:', '--out', str(tmp_path / 'out')]
    assert main(['compensate', *words.split(), *needed]) == 2
    assert sentence in capsys.readouterr().err


def test_an_address_of_another_kind_is_reported() -> None:
    with served('serial') as (address, _), pytest.raises(DriverError, match='no answer'):
        open_controller(address.replace('gcs', 'nv200'), timeout=0.1)


@pytest.mark.parametrize('limits', [(1.0, 2.0, None), (2.0, -2.0, None), (None, None, 0.0)])
def test_limits_that_allow_nothing_are_refused(
    limits: tuple[float | None, float | None, float | None],
) -> None:
    with pytest.raises(DriverError, match='allow nothing'):
        open_controller('gcs://127.0.0.1', '1', *limits)


@pytest.fixture(scope='module')
def small_model(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the model of a sweep of the simulated stage, as a file."""
    specs = simulated_grid('sine', [1.0, 5.0, 20.0, 50.0], [1.0, 0.5], {'duration': 2.5})
    path = tmp_path_factory.mktemp('model') / 'model.yaml'
    records = simulate('generic_bouc_wen', specs, QUIET, 1, 1000.0)
    identify(records, named('classical')).model.save(path)
    return path


@pytest.mark.component
def test_an_investigation_runs_in_the_controller(
    small_model: Path, tmp_path: Path, capsys: Any
) -> None:
    plant = Plant.from_preset('generic_bouc_wen', RATE, 3, QUIET | {'effects.creep': True})
    simulated = SimulatedController(plant, np.inf)
    server = GcsServer(simulated)
    out = tmp_path / 'out'
    with running(server, 0.01):
        address = f'gcs://127.0.0.1:{server.server_address[1]}'
        words = ['investigate', '--on', address, '--model', str(small_model)]
        words += ['--out', str(out), '--low', '-1', '--high', '1', '--slew', '700']
        assert main([*words, '--low', '-99']) == 2
        assert 'exceed the -5 .. 1 V' in capsys.readouterr().err
        assert not out.exists()
        assert main([*words, '--namespace', 'x']) == 2
        assert '--namespace: not used with --on' in capsys.readouterr().err
        assert main(words) == 0
    server.server_close()
    assert simulated.voltage == 0.0
    assert 'creep' in capsys.readouterr().out
    found = json.loads((out / 'investigation.json').read_text())
    assert found['verdict'] == 'named'
    assert 'creep' in found['effects']
    assert found['seconds'] < 60.0
    assert found['after_in_floors'] < 0.5 * found['before_in_floors']
    bags = sorted((out / 'bags').iterdir())
    assert len(bags) == found['experiments'] + 1
    for bag in bags:
        (record,) = load(bag)
        assert record.rate == 1000.0
        assert np.abs(record.voltage).max() <= 1.0
        assert (bag / 'controller.yaml').is_file()


@pytest.mark.slow
def test_three_commands_from_open_loop_to_the_noise(tmp_path: Path) -> None:
    with serving(speed=20.0) as server:
        tracked(server.server_address[1], tmp_path)


def tracked(port: int, tmp_path: Path) -> None:
    bag = tmp_path / 'bag'
    words = ['sweep', '--on', f'gcs://127.0.0.1:{port}', '--frequencies', '5,23']
    words += ['--amplitudes', '0.5,1', '--seconds', '1', '--actuator', 'bender', '--out', str(bag)]
    assert main(words) == 0
    records = load(bag)
    first = records[0]
    assert (first.name, first.rate, len(first)) == ('sine_5Hz_0.5V', RATE, 20_000)
    assert [record.info.amplitude for record in records] == [0.5, 0.5, 1.0, 1.0]
    assert {record.info.actuator for record in records} == {'bender'}
    about = yaml.safe_load((bag / 'controller.yaml').read_text())
    assert about['controller']['rate'] == RATE
    assert main(words) == 2  # the bag is there
    model, out = tmp_path / 'model', tmp_path / 'tracked'
    assert main(['identify', str(bag), '--model', 'bouc_wen_mode', '--out', str(model)]) == 0
    words = ['compensate', '--on', f'gcs://127.0.0.1:{port}', '--model', f'{model}/model.yaml']
    words += ['--reference', 'sine:frequency=23,amplitude=100e-6,duration=2', '--out', str(out)]
    assert main(words) == 0
    (record,) = load(out / 'voltage.csv')
    assert record.reference is not None
    error = (record.displacement - record.reference)[-20_000:]
    assert np.sqrt(np.mean(error**2)) < 3 * 2e-8  # noise floors


REFUSED: dict[str, tuple[Limits, dict[str, Any], str]] = {
    'range': (Limits(-0.5, 0.5, np.inf), {}, 'leaves the range -0.5 .. 0.5 V'),
    'range of the controller': (
        Limits(-99.0, 99.0, np.inf),
        {'amplitudes': [6.0]},
        'the range -5 .. 5 V',
    ),
    'slew': (replace(UNLIMITED, slew=10.0), {'frequencies': [50.0]}, 'the limit is 10 V/s'),
    'rate': (UNLIMITED, {'frequencies': [15_000.0]}, 'cannot be sampled at 20000 Hz'),
}


@pytest.mark.parametrize('why', REFUSED)
def test_what_leaves_the_limits_is_refused_before_it_is_loaded(
    server: GcsServer, why: str
) -> None:
    limits, settings, sentence = REFUSED[why]
    chosen = {'frequencies': [5.0], 'amplitudes': [1.0], 'seconds': 0.5, **settings}
    with connected(server, limits) as made:
        made.open_loop()
        with pytest.raises(Exception, match=sentence):
            sweep(made, **chosen)
    assert server.controller.tables == {}


def test_a_long_record_is_sampled_slower(server: GcsServer) -> None:
    with connected(server) as made:
        made.open_loop()
        (record,) = sweep(made, [1.0], [1.0], 5.0)
    assert record.rate == RATE / 2
    assert len(record) == 50_000 < GcsController.most_points


@pytest.mark.parametrize('divider', [2, 20])
def test_a_voltage_of_a_slower_record_is_the_one_that_was_reached(divider: int) -> None:
    rise = 0.5 - 0.5 * np.cos(np.pi * np.arange(2001) / 2000)
    curves = []
    for ticks in (1, divider):
        plant = Plant.from_preset('generic_bouc_wen', RATE, 3, {'effects.noise': False})
        server = GcsServer(SimulatedController(plant, np.inf))
        with running(server, 0.01), connected(server) as made:
            made.open_loop()
            curves.append(driver_sweep.measured(made, 'rise', rise[::ticks], RecordInfo(), ticks))
        server.server_close()
    fine, coarse = curves
    found = np.interp(coarse.voltage[:-1], fine.voltage[:-1], fine.displacement[1:])
    # before: the next voltage, which is reached a tick later
    late = np.interp(rise[divider::divider], fine.voltage[:-1], fine.displacement[1:])
    assert np.abs(coarse.displacement[1:] - found).max() < 1e-9
    assert np.abs(coarse.displacement[1:] - late).max() > 2e-8


@pytest.mark.parametrize(
    ('text', 'sentence'),
    [('WAV 1 X PNT 1 3 0 1', 'parameters'), ('ABC', 'does not know'), ('SVA 2 1', 'no such axis'),
     ('SVA 1 9', 'beyond the limits')],
)  # fmt: skip
def test_a_refusal_of_the_controller_is_a_sentence(
    server: GcsServer, text: str, sentence: str
) -> None:
    with (
        closing(GcsConnection(TcpWire('127.0.0.1', server.server_address[1]))) as line,
        pytest.raises(DriverError, match=sentence),
    ):
        line.command(text)


def test_wrong_addresses_are_reported(capsys: Any) -> None:
    words = ['--frequencies', '1', '--amplitudes', '1', '--out', 'nowhere']
    assert main(['sweep', '--on', 'tcp://x', *words]) == 2
    assert 'write gcs://HOST' in capsys.readouterr().err
    for address in ('gcs:///dev/none', 'gcs://', 'gcs:///dev/x?bauds=1', 'nv200:///dev/x?baud=a'):
        assert main(['sweep', '--on', address, *words]) == 2
        assert capsys.readouterr().err.count('\n') == 1
    with socket.socket() as free:
        free.bind(('127.0.0.1', 0))
        port = free.getsockname()[1]
    assert main(['sweep', '--on', f'gcs://127.0.0.1:{port}', *words]) == 2
    assert 'no controller answers' in capsys.readouterr().err


def measured(address: str) -> str:
    """Return '' or the sentence with which a sweep ended."""
    try:
        with open_controller(address, timeout=0.2) as made:
            made.open_loop()
            sweep(made, [20.0], [1.0], 0.05)
    except DriverError as error:
        return str(error)
    return ''


def largest_voltage(controller: SimulatedController) -> float:
    """Return the largest voltage that was recorded [V]."""
    recorder = controller.recorder
    tables = [table for table, option in recorder.options.items() if option == OUTPUT]
    parts = [part for table in tables for part in recorder.samples.get(table, [])]
    return max((float(np.abs(part).max(initial=0.0)) for part in parts), default=0.0)


def lines_of_a_sweep(kind: str) -> int:
    fault = Fault('count', 10**9)
    with served(kind, fault=fault) as (address, _):
        assert measured(address) == ''
    return 10**9 - fault.after


@pytest.mark.slow
@pytest.mark.parametrize('kind', KINDS)
@pytest.mark.parametrize('fault', FAULTS)
def test_a_connection_lost_at_any_moment_leaves_the_output_at_rest(kind: str, fault: str) -> None:
    """Twenty random moments: the generator ends by itself, within the limits, at 0 V."""
    rng, total = np.random.default_rng(7), lines_of_a_sweep(kind)
    for after in rng.integers(0, total, 20):
        with served(kind, fault=Fault(fault, int(after))) as (address, controller):
            assert '\n' not in measured(address)
            controller.advance()
            assert not controller.is_running
            assert abs(controller.voltage) < 1e-5  # percent of a range, as NV200 takes it
            assert largest_voltage(controller) <= 1.0 + 1e-5


def order(bag: Path, **changes: Any) -> ControllerSweep:
    return replace(ControllerSweep(bag, [20.0], [1.0], 0.1), **changes)


@contextmanager
def driving(address: str, timeout: float = 5.0) -> Iterator[ControllerThread]:
    thread = ControllerThread(
        lambda: open_controller(address, timeout=timeout), lambda *state: None, 0.01
    )
    try:
        until(lambda: not thread.problem)
        yield thread
    finally:
        thread.close()


def voltage_of(controller: SimulatedController) -> float:
    """Return the voltage, a tick after the last command [V]."""
    time.sleep(2e-3)
    controller.advance()
    return controller.voltage


def until(condition: Callable[[], bool], seconds: float = 10.0) -> None:
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.01)


@pytest.mark.slow
@pytest.mark.parametrize('kind', KINDS)
def test_a_thread_that_loses_its_controller_leaves_it_at_rest(kind: str, tmp_path: Path) -> None:
    """Twenty random moments, while time goes on by the clock."""
    rng = np.random.default_rng(5)
    for k in range(20):
        fault = Fault()
        with served(kind, 1.0, fault) as (address, controller):
            with driving(address, 0.3) as thread:
                running = thread.run(order(tmp_path / f'{k}'))
                time.sleep(rng.uniform(0.0, 1.5 if kind == 'nv200' else 0.6))
                fault.after, fault.kind = 0, str(rng.choice(FAULTS))
                assert '\n' not in running.result(20.0).reason
            end = time.monotonic() + 5.0
            while controller.is_running and time.monotonic() < end:
                time.sleep(0.01)
            assert not controller.is_running
            assert abs(voltage_of(controller)) < 1e-5
            assert largest_voltage(controller) <= 1.0 + 1e-5


def test_a_thread_keeps_what_is_complete_and_ends_at_rest(tmp_path: Path) -> None:
    seen: list[SweepProgress] = []
    with served('tcp', 5.0) as (address, controller):
        with driving(address) as thread:
            refused = thread.check(order(tmp_path / 'bag', amplitudes=[9.0]))
            assert 'record sine_20Hz_9V: a wave of' in refused
            assert thread.check(order(tmp_path / 'bag')) == ''
            long = order(tmp_path / 'deep' / 'bag', frequencies=[20.0, 30.0], seconds=1.0)
            running = thread.run(
                long, seen.append, lambda: bool(seen) and seen[-1].record == 'sine_30Hz_1V'
            )
            assert running.result(20.0).is_cancelled
            assert voltage_of(controller) == 0.0
            assert [record.name for record in load(long.bag)] == ['sine_20Hz_1V']
            again = thread.run(replace(long, frequencies=[20.0])).result(20.0)
            assert 'exists already' in again.reason
            running = thread.run(order(tmp_path / 'never', seconds=2.5))
            until(lambda: abs(controller.voltage) > 0.1)
        assert running.result(1.0).is_cancelled
        assert voltage_of(controller) == 0.0
        assert not controller.is_running


def test_a_thread_that_drove_nothing_leaves_the_controller_as_it_is() -> None:
    with served('tcp', 1.0) as (address, controller):
        controller.set_voltage(1.5)
        with driving(address):
            pass
        assert voltage_of(controller) == 1.5


@pytest.mark.parametrize('kind', KINDS)
def test_what_comes_late_is_no_answer_to_the_next_query(kind: str) -> None:
    fault = Fault()
    with served(kind, 1.0, fault) as (address, controller):
        with open_controller(address, timeout=0.2) as made:
            made.open_loop()
            controller.set_voltage(0.5)
            fault.after, fault.kind = 0, 'late'
            with pytest.raises(DriverError, match='no answer to'):
                made.voltage  # noqa: B018
            assert not made.is_running
            assert made.voltage == 0.5
        assert voltage_of(controller) == 0.0


@pytest.mark.parametrize('kind', KINDS)
def test_a_lost_connection_is_a_sentence(kind: str) -> None:
    with served(kind, fault=Fault('drop', 12)) as (address, controller):
        assert 'the connection is lost' in measured(address)
        assert abs(voltage_of(controller)) < 1e-5


def test_the_generator_finishes_without_a_client() -> None:
    clock = [0.0]
    plant = Plant.from_preset(PRESET, RATE)
    simulated = SimulatedController(plant, 1.0, now=lambda: clock[0])
    simulated.tables[1] = np.concatenate([np.ones(2000), np.zeros(1)])
    simulated.generator.table, simulated.generator.cycles = 1, 1
    simulated.start()
    clock[0] = 0.05
    assert simulated.is_running
    assert simulated.voltage == 1.0
    clock[0] = 0.2
    assert not simulated.is_running
    assert simulated.voltage == 0.0


def test_a_run_that_fails_is_stopped_and_brought_to_rest(monkeypatch: Any) -> None:
    monkeypatch.setattr('piezo_hysteresis.drivers.controller._AFTER', -0.35)
    with serving(speed=1.0) as made, connected(made, replace(UNLIMITED, slew=1e6)) as controller:
        controller.open_loop()
        wave = np.concatenate([[0.0], np.ones(8000), [0.0]])
        with pytest.raises(DriverError, match='does not end'):
            controller.play(wave)
        assert not controller.is_running
        assert controller.voltage == 0.0


@pytest.mark.component
def test_a_model_of_the_actuator_learns_in_a_few_runs(monkeypatch: Any) -> None:
    """The plant is a linear mode of other numbers than the model's, with an odd distortion."""
    model = named('linear_mode')
    values = {**model.defaults(), 'A1': 1e-4, 'natural_frequency': 300.0, 'damping_ratio': 0.05}
    loaded = ModelFile(model, values)
    with serving() as server, connected(server) as made:
        made.open_loop()
        learning = Learning(made, loaded, Sine(3e-5, 20.0, 0.5))

        def played(wave: np.ndarray, divider: int = 1) -> Measurement:
            bent = model.respond(
                wave + 0.05 * wave**3, model.pack({**values, 'A1': 1.3e-4}), learning.dt
            )
            return Measurement(learning.dt, wave, bent)

        monkeypatch.setattr(made, 'play', played)
        runs = list(learning.runs(6))
    assert [run.name for run in runs[:3]] == ['no compensation', 'feedforward', 'learnt 1']
    assert runs[-1].rms < 0.02 * runs[1].rms


@pytest.mark.parametrize(
    ('reference', 'sentence'),
    [(Sine(3e-5, 20.0, float('inf')), 'needs an end'), (Sine(3e-5, 3000.0, 1.0), 'too fast')],
)
def test_a_reference_that_cannot_be_learnt_is_refused(
    server: GcsServer, reference: Sine, sentence: str
) -> None:
    model = named('linear_mode')
    with connected(server) as made, pytest.raises(DriverError, match=sentence):
        Learning(made, ModelFile(model, model.defaults()), reference)


def test_the_servo_must_be_off(server: GcsServer) -> None:
    server.controller.switch_servo(True)
    with connected(server) as made:
        with pytest.raises(DriverError, match='the servo is on'):
            made.play(np.zeros(10))
        made.open_loop()
        assert not server.controller.servo

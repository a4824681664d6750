"""A controller is ours before it moves, keeps the slew at each tick, plays what was planned."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from test_drivers_gcs import KINDS, PRESET, RATE, connected, running, served, serving

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.drivers import DriverError, Measurement, open_controller, sweep
from piezo_hysteresis.drivers.tracking import Learning
from piezo_hysteresis.models import ModelFile, named
from piezo_hysteresis.waveforms import Sine
from piezo_sim.gcs.controller import Generator, SimulatedController
from piezo_sim.gcs.language import Language
from piezo_sim.gcs.nv200 import Nv200Language
from piezo_sim.gcs.server import GcsServer
from piezo_sim.plant import Plant

SLEW = 900.0


@contextmanager
def every_tick(controller: SimulatedController) -> Iterator[list[FloatArray]]:
    """Yield what the output does, tick by tick [V]."""
    usual, ticks = controller.plant.run, [np.array([controller.voltage])]

    def noted(voltages: FloatArray) -> FloatArray:
        ticks.append(voltages.copy())
        return usual(voltages)

    vars(controller.plant)['run'] = noted
    yield ticks
    controller.advance()
    del vars(controller.plant)['run']


def fastest(ticks: list[FloatArray]) -> float:
    """Return the largest change within a tick [V/s]."""
    return float(np.abs(np.diff(np.concatenate(ticks))).max()) * RATE


def play_elsewhere(controller: SimulatedController, seconds: float = 5.0) -> None:
    """Let another client play a sine of 2 V at 20 Hz, within the slew limit."""
    phase = 2.0 * np.pi * 20.0 * np.arange(round(seconds * RATE)) / RATE
    controller.tables[2] = 2.0 * np.sin(phase)
    controller.generator = Generator(table=2, cycles=1)
    controller.start()


def test_the_wave_of_another_client_is_left_alone_or_taken_over() -> None:
    with serving(speed=1.0) as server:
        address = f'gcs://127.0.0.1:{server.server_address[1]}'
        play_elsewhere(server.controller)
        with (
            open_controller(address, slew=SLEW) as made,
            pytest.raises(DriverError, match='its wave generator runs, started by another'),
        ):
            made.open_loop()
        assert server.controller.is_running
        with every_tick(server.controller) as ticks:
            with open_controller(address, slew=SLEW, take_over=True) as made:
                made.open_loop()
                assert not server.controller.is_running
            assert server.controller.voltage == 0.0
        assert fastest(ticks) <= SLEW * (1.0 + 1e-6)


def test_a_second_sweep_of_the_suite_waits_for_the_first() -> None:
    with serving() as server:
        address = f'gcs://127.0.0.1:{server.server_address[1]}'
        with open_controller(address) as first, open_controller(address) as second:
            first.open_loop()
            with pytest.raises(DriverError, match='another sweep of this suite drives it'):
                second.open_loop()
            assert len(sweep(first, [100.0], [1.0], 0.02)) == 1
            first.release()
            second.open_loop()


@pytest.mark.parametrize('kind', KINDS)
@pytest.mark.parametrize('begin', [0.3, -1.1])
def test_the_slew_holds_at_every_tick_of_a_ramp(kind: str, begin: float) -> None:
    with served(kind, speed=1.0) as (address, controller):
        controller.set_voltage(begin)
        while controller.voltage != begin:
            controller.advance()
        with every_tick(controller) as ticks:
            with open_controller(address, slew=SLEW) as made:
                made.open_loop()
                made.set_voltage(-begin)
            controller.advance()
            assert abs(controller.voltage) < 1e-5
        assert max(np.abs(part).max() for part in ticks) > 0.2
        assert fastest(ticks) <= SLEW * (1.0 + 1e-6)


def test_a_cancelled_wave_comes_to_rest_within_the_slew() -> None:
    def cancel() -> None:
        if abs(server.controller.voltage) > 0.5:
            raise KeyboardInterrupt

    with serving(speed=1.0) as server, every_tick(server.controller) as ticks:
        address = f'gcs://127.0.0.1:{server.server_address[1]}'
        with suppress(KeyboardInterrupt), open_controller(address, slew=SLEW) as made:
            made.open_loop()
            sweep(made, [5.0], [1.0], 1.0, watch=cancel)
    assert server.controller.voltage == 0.0
    assert fastest(ticks) <= SLEW * (1.0 + 1e-6)


def test_a_wave_that_another_client_stops_is_no_record() -> None:
    def stop() -> None:
        if abs(server.controller.voltage) > 0.5:
            server.controller.stop()

    with serving(speed=1.0) as server:
        address = f'gcs://127.0.0.1:{server.server_address[1]}'
        with open_controller(address, slew=SLEW) as made:
            made.open_loop()
            with pytest.raises(DriverError, match='the output was not the wave'):
                sweep(made, [5.0], [1.0], 0.6, watch=stop)
        assert server.controller.voltage == 0.0


@pytest.mark.parametrize('command', ['VMI?', 'SPA?', 'DRR?'])
def test_a_controller_without_a_command_is_said_to_lack_it(command: str) -> None:
    def measure() -> None:
        with open_controller(f'gcs://127.0.0.1:{server.server_address[1]}') as made:
            made.open_loop()
            sweep(made, [100.0], [1.0], 0.02)

    with serving() as server:
        del vars(server.language)['_known'][command]
        with pytest.raises(DriverError, match=rf'{command[:3]}.* it does not know the command'):
            measure()


@pytest.mark.parametrize(('unit', 'scale'), [('UM', 1.0), ('MM', 1e3), ('nm', 1e-3)])
def test_the_unit_of_a_position_is_asked(unit: str, scale: float, monkeypatch: Any) -> None:
    with serving() as server:
        address = f'gcs://127.0.0.1:{server.server_address[1]}'
        server.controller.set_voltage(1.0)
        for _ in range(2000):
            server.controller.advance()
        with open_controller(address) as made:
            usual = made.displacement
        monkeypatch.setattr(server.language, 'unit', unit)
        with open_controller(address) as made:
            assert made.displacement == pytest.approx(scale * usual, rel=0.3)


def test_a_position_that_is_no_length_is_refused(monkeypatch: Any) -> None:
    with serving() as server:
        monkeypatch.setattr(server.language, 'unit', 'MRAD')
        with pytest.raises(DriverError, match="has the unit 'MRAD', which is no length"):
            open_controller(f'gcs://127.0.0.1:{server.server_address[1]}')


@pytest.mark.parametrize(
    ('name', 'value', 'sentence'),
    [('unitcl', 'mrad', "the unit 'mrad', which is no length"),
     ('acmeasure', '0', 'the actuator has no position sensor')],
)  # fmt: skip
def test_an_nv200_is_asked_what_it_measures(
    name: str, value: str, sentence: str, monkeypatch: Any
) -> None:
    usual = Nv200Language.value_of
    monkeypatch.setattr(
        Nv200Language,
        'value_of',
        lambda self, word, parts: value if word == name else usual(self, word, parts),
    )
    with served('nv200') as (address, _), pytest.raises(DriverError, match=sentence):
        open_controller(address)


@pytest.mark.parametrize('has_one_rate', [False, True])
def test_a_long_wave_is_played_in_straight_lines(has_one_rate: bool, monkeypatch: Any) -> None:
    """Also where all generators share one rate, which refuses a rate of one of them."""
    with serving() as server:
        monkeypatch.setattr(server.language, '_has_one_rate', has_one_rate)
        with open_controller(f'gcs://127.0.0.1:{server.server_address[1]}', slew=SLEW) as made:
            made.open_loop()
            wave = np.concatenate([[0.0], np.sin(np.arange(300) * np.pi / 300), [0.0]])
            with every_tick(server.controller) as ticks:
                made.play(wave, 10)
        assert fastest(ticks) < 1.01 * np.pi / 300 * RATE / 10  # not in steps of ten ticks


def two_axes(*, has_one_rate: bool) -> tuple[list[SimulatedController], Language]:
    """Return controllers of two axes whose wave generators play tables at different rates."""
    axes = [SimulatedController(Plant.from_preset(PRESET, RATE), np.inf) for _ in range(2)]
    axes[0].generator.divider = 7
    axes[0].recorder.divider = 7
    return axes, Language(*axes, has_one_rate=has_one_rate)


@pytest.mark.parametrize('has_one_rate', [False, True])
@pytest.mark.parametrize('seconds', [0.5, 8.0])
def test_a_sweep_of_the_second_axis_has_its_own_rate(has_one_rate: bool, seconds: float) -> None:
    axes, language = two_axes(has_one_rate=has_one_rate)
    server = GcsServer(axes[0], 0, language=language)
    with running(server, 0.01):
        address = f'gcs://127.0.0.1:{server.server_address[1]}'
        with open_controller(address, axis='2') as made:
            made.open_loop()
            divider = made.divider_for(seconds + 1.0)
            (record,) = sweep(made, [20.0], [1.0], seconds)
    server.server_close()
    assert divider == (1 if seconds < 1.0 else 3)
    assert record.rate == pytest.approx(RATE / divider, rel=1e-9)
    time = record.dt * np.arange(len(record))
    spectrum = np.abs(np.fft.rfft(record.voltage))
    assert np.argmax(spectrum) / time.size / record.dt == pytest.approx(20.0, abs=0.01)
    assert np.ptp(record.displacement) > 1e-4
    if not has_one_rate:  # the rate of the other generator is as it was
        assert axes[0].generator.divider == 7


def test_a_record_of_another_rate_than_asked_for_is_refused(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """As if another client set the rate of the common recorder, or it does not take ours."""
    with serving() as server, connected(server) as made:
        made.open_loop()
        played = made.recorded
        monkeypatch.setattr(
            made, 'recorded', lambda *given: played(*given)._replace(dt=7.0 / RATE)
        )
        with pytest.raises(DriverError, match='recorded at 2857 Hz instead of 20000 Hz'):
            sweep(made, [20.0], [1.0], 0.5)


@pytest.mark.parametrize(
    ('gain', 'sentence'), [(-1.0, 'moves against the voltage'), (0.0, 'does not follow')]
)
def test_nothing_is_learnt_from_a_sensor_that_does_not_follow(
    monkeypatch: pytest.MonkeyPatch, gain: float, sentence: str
) -> None:
    model = named('linear_mode')
    loaded = ModelFile(model, {**model.defaults(), 'A1': 1e-4})
    with serving() as server, connected(server) as made:
        made.open_loop()
        learning = Learning(made, loaded, Sine(3e-5, 20.0, 0.5))
        played = made.play

        def reversed_(wave: np.ndarray, divider: int = 1) -> Measurement:
            measured = played(wave, divider)
            rest = measured.displacement[0]
            return measured._replace(displacement=rest + gain * (measured.displacement - rest))

        monkeypatch.setattr(made, 'play', reversed_)
        runs = learning.runs(6)
        assert next(runs).name == 'no compensation'
        with pytest.raises(DriverError, match=sentence):
            next(runs)


def test_no_page_claims_the_d_drive() -> None:
    """Another protocol, by the client psj-lib 1.2.2 of its maker: channels, errors as text."""
    folder = Path(__file__).parents[2]
    pages = [folder / 'README.md', *folder.glob('docs/**/*.md'), *folder.glob('src/**/*.py')]
    claims = [page for page in pages if re.search(r'\bd-?drive', page.read_text(), re.IGNORECASE)]
    assert claims == []

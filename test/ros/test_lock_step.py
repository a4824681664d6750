"""The loop of nodes gives the numbers of the offline function."""

from __future__ import annotations

import signal
from pathlib import Path

import numpy as np
import pytest
from listening import Listener
from live_nodes import LiveNodes

from piezo_hysteresis.common.registry import package_of
from piezo_hysteresis.compensation.harmonics.harmonic_attenuation import (
    AttenuationSettings,
    HarmonicAttenuation,
)
from piezo_hysteresis.compensation.inverses.physical import ExtendedInverse
from piezo_hysteresis.compensation.linear_gain import ModeGain
from piezo_hysteresis.compensation.link import Limits, Link
from piezo_hysteresis.compensation.offline_loop import LoopResult, closed_loop
from piezo_hysteresis.identification.rls import OnlineRls, RlsSettings
from piezo_hysteresis.models import ModelFile, named
from piezo_hysteresis.parameters.node_tables import ATTENUATION
from piezo_hysteresis.ros.processes import NodeProcess
from piezo_hysteresis.waveforms import Sine
from piezo_interfaces.msg import ActuatorState, ModelEstimate
from piezo_sim.plant import Plant

pytestmark = pytest.mark.ros

SAMPLES = 2000
RATE = 1000.0
FREQUENCY = 23.0
AMPLITUDE = 1.1e-4
MODEL = {
    'A1': 1.0e-4,
    'A': 2.5e-5,
    'A0': 1e-6,
    'beta': 0.6,
    'gamma': 0.1,
    'c1': 0.4752,
    'c2': -0.7983,
    'offset': 6e-6,
}
# The all-pole form has the gain 1 / (-c1 - c2) at rest.
MODEL['A1'] *= -MODEL['c1'] - MODEL['c2']
MODEL['A'] *= -MODEL['c1'] - MODEL['c2']

MODE = {'plant.gain': 1.2e-4, 'plant.natural_frequency': 68.0, 'plant.damping_ratio': 0.015}
# The offline function trusts its sensor from the first tick on.
TRUST = {'sensor_check': False}


def offline() -> LoopResult:
    time = np.arange(SAMPLES, dtype=np.float64) * (1.0 / RATE)
    limits = Limits(-1.2, 1.2, 2000.0)
    step = ATTENUATION.defaults()['gain']
    assert isinstance(step, float)
    settings = AttenuationSettings(method='rls', orders=(3,), sign_rule='computed', gain=step)
    gain = ModeGain(
        MODE['plant.gain'],
        MODE['plant.natural_frequency'],
        MODE['plant.damping_ratio'],
        1.0 / RATE,
    )
    links: list[Link] = [
        ExtendedInverse(MODEL, 1.0 / RATE, limits=limits),
        HarmonicAttenuation(settings, gain, 1.0 / RATE),
    ]
    plant = Plant.from_preset('fdk_pzba_00030', rate=RATE, seed=7)
    reference = Sine(AMPLITUDE, FREQUENCY, SAMPLES / RATE, ramp=1.0).sample(time)
    return closed_loop(reference, links, plant, limits, 1.0 / RATE)


def test_nodes_give_the_numbers_of_the_offline_loop(
    processes: LiveNodes, listener: Listener, tmp_path: Path
) -> None:
    model = tmp_path / 'model.yaml'
    ModelFile(named('extended'), MODEL).save(model)
    listener.listen(ActuatorState, 'actuator/state')
    listener.listen(ModelEstimate, 'model/estimate', latched=True)
    processes.start('piezo_sim', 'simulator', {'clock': 'lock_step', 'seed': 7, 'wait_for': 4})
    processes.start('piezo_hysteresis', 'feedforward', {'model_file': str(model)})
    processes.start(
        'piezo_hysteresis', 'attenuation', {**MODE, **TRUST, 'method': 'rls', 'orders': [3]}
    )
    processes.start('piezo_hysteresis', 'identification', {'publish_every': SAMPLES})
    listener.matched('actuator/state')
    listener.matched('model/estimate')
    excitation = processes.start(
        'piezo_hysteresis',
        'excitation',
        {
            'mode': 'reference',
            'frequency': FREQUENCY,
            'reference.amplitude': AMPLITUDE,
            'duration': SAMPLES / RATE,
            'exit_when_done': True,
            'wait_for': 2,
        },
    )
    states = listener.received['actuator/state']
    listener.until(
        lambda: len(states) >= SAMPLES and bool(listener.received['model/estimate']), 60.0
    )
    assert processes.wait_for(excitation, 20.0) == 0

    expected = offline()
    assert [state.sample for state in states] == list(range(SAMPLES))
    voltage = np.array([state.voltage for state in states])
    displacement = np.array([state.displacement for state in states])
    np.testing.assert_allclose(voltage, expected.voltage, rtol=0, atol=1e-12)
    np.testing.assert_allclose(displacement, expected.displacement, rtol=0, atol=1e-12)

    rls = OnlineRls(RlsSettings(dt=1.0 / RATE))
    rls.update_many(voltage, displacement)
    estimate = listener.received['model/estimate'][-1]
    known = dict(zip(estimate.names, estimate.values, strict=True))
    assert known.pop('offset') == 0.0  # of the named model; no column stands for it
    assert known == pytest.approx(rls.estimate().parameters(), rel=1e-12)
    assert np.max(np.abs(voltage)) > 0.3


@pytest.mark.parametrize(
    'killed',
    [
        ('attenuation', 'simulator'),
        pytest.param(
            ('attenuation', 'simulator', 'attenuation', 'attenuation'), marks=pytest.mark.slow
        ),
    ],
    ids=['once', 'often'],
)
def test_what_is_started_anew_moves_the_actuator_no_faster_than_the_slew(
    processes: LiveNodes, listener: Listener, killed: tuple[str, ...]
) -> None:
    slew: dict[str, object] = {'limits.slew': 60.0}
    per_tick = 60.0 / RATE
    settings: dict[str, dict[str, object]] = {
        'simulator': {'clock': 'lock_step', 'wait_for': 3},
        'attenuation': {**slew, **MODE},
    }

    def start(name: str) -> NodeProcess:
        return processes.start(package_of(name), name, settings[name])

    states = listener.listen(ActuatorState, 'actuator/state')
    running = {name: start(name) for name in settings}
    processes.start('piezo_hysteresis', 'feedforward', slew)
    processes.start(
        'piezo_hysteresis',
        'excitation',
        {'mode': 'reference', 'frequency': 7.0, 'reference.amplitude': 1e-4, 'ramp': 0.2},
    )
    listener.until(lambda: states and states[-1].sample > 700)
    for name in killed:
        running[name].signal(signal.SIGKILL)
        processes.retire(running[name])
        count = -1
        while len(states) > count:  # a starved listener still hears what was before
            count = len(states)
            listener.serve(0.3)
        # The feedforward hears the actuator while no reference comes; the listener is the fourth.
        settings['simulator']['wait_for'] = 4
        last, stood = states[-1].voltage, states[-1].sample
        begin = len(states)
        running[name] = start(name)
        listener.until(lambda n=begin: len(states) > n + 500)
        if name == 'simulator':
            assert states[begin].sample == 0
            last = 0.0  # where a fresh actuator rests
        else:
            assert states[begin].sample == stood + 1
        applied = np.array([last, *(state.voltage for state in states[begin:])])
        assert np.max(np.abs(np.diff(applied))) <= per_tick * (1.0 + 1e-9)
        assert np.ptp(applied) > 0.3

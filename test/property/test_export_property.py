"""The C library answers what the kernels in Python answer: the same bits, whatever the input."""

from __future__ import annotations

import ctypes
import functools
import subprocess
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from piezo_hysteresis.blocks import BLOCKS
from piezo_hysteresis.blocks.parallel import parallel_block
from piezo_hysteresis.compensation.feedback import hinf
from piezo_hysteresis.compensation.feedback.feedback_link import HInfinityWeights
from piezo_hysteresis.compensation.feedback.hinf import HInfinity
from piezo_hysteresis.compensation.feedback.pid import FuzzyPid, FuzzyRules, Pid, PidGains
from piezo_hysteresis.compensation.harmonics.harmonic_attenuation import (
    AttenuationSettings,
    HarmonicAttenuation,
)
from piezo_hysteresis.compensation.inverses.inverse_choice import inverse_for
from piezo_hysteresis.compensation.inverses.inverse_link import InverseLink
from piezo_hysteresis.compensation.limiter import EnergyLimits
from piezo_hysteresis.compensation.linear_gain import ModeGain
from piezo_hysteresis.compensation.link import INVERSES, Limits
from piezo_hysteresis.compensation.offline_loop import ModelPlant, closed_loop
from piezo_hysteresis.errors import PiezoError
from piezo_hysteresis.export.compensator import compensator_doors, compensator_of, plant_doors
from piezo_hysteresis.export.header import of_model
from piezo_hysteresis.export.native import object_code
from piezo_hysteresis.export.pieces import plant_of
from piezo_hysteresis.export.sections import (
    inverse_section,
    limiter_section,
    limits_fields,
    section_of,
)
from piezo_hysteresis.models import NAMES, Model, named
from piezo_hysteresis.waveforms import Sine
from piezo_hysteresis.waveforms.waveform import Samples

pytestmark = pytest.mark.slow

DT, MARK = 1e-3, 7.0
LIMITS = Limits(-1.2, 1.2, 2000.0)
GAIN = ModeGain(115e-6, 68.0, 0.015, DT)
VALUES = {
    'delay': 0.37e-3, 'lag_time': 2e-4, 'sensor_lag_time': 1e-4, 'creep_share': 0.1,
    'drift_rate': 1e-7, 'hum_sine': 1e-7, 'gain_loss': 0.1, 'mode_cubic': 1e6,
    'mode_friction': 1e-6, 'backlash': 1e-7, 'stiction': 1e-7, 'electrostriction': 1e-6,
}  # fmt: skip
CHAINS = (
    ('transport_delay', 'bouc_wen_exact', 'mode', 'creep'),
    ('transport_delay', 'amplifier_lag', 'bouc_wen_exact', 'mode', 'backlash', 'sensor_lag'),
    ('amplifier_lag', 'bouc_wen_oscillator'),
    ('slew_limit', 'bouc_wen_exact', 'mode'),
    ('slew_limit', 'mode'),
    ('bouc_wen_exact', 'nonlinear_mode', 'creep', 'gain_decay'),
    ('amplifier_lag', 'preisach', 'mode', 'drift', 'logarithmic_creep', 'sensor_nonlinearity'),
    ('prandtl_ishlinskii', 'mode_pair', 'creep_pair', 'sensor_curve', 'mains_hum'),
)


def models() -> Iterator[Model]:
    """Return every named model, chains with paths between the ticks, all other blocks alone."""
    yield from map(named, NAMES)
    covered = {block.name for name in NAMES for block in named(name).blocks}.union(*CHAINS)
    yield from (Model(f'block {k}', (b,)) for k, b in BLOCKS.items() if k not in covered)
    yield from (Model('+'.join(names), tuple(BLOCKS[name] for name in names)) for names in CHAINS)
    both = parallel_block(BLOCKS['bouc_wen_exact'], BLOCKS['electrostriction'])
    yield Model('side by side', (both, BLOCKS['mode']))


MODELS = {model.name: model for model in models()}


def values_of(model: Any) -> dict[Any, Any]:
    return {**model.defaults(), **{k: v for k, v in VALUES.items() if k in model.parameter_names}}


def library(doors: Any) -> Any:
    """Return a library that is loaded into this process."""
    folder = Path(tempfile.mkdtemp())
    (folder / 'all.o').write_bytes(object_code(doors, 'x86_64-linux'))
    files: list[str | Path] = [folder / 'all.so', folder / 'all.o']
    subprocess.run(['gcc', '-shared', '-o', *files, '-lm'], check=True, capture_output=True)
    return ctypes.CDLL(str(folder / 'all.so'))


def at(array: Any) -> Any:
    return array.ctypes.data_as(ctypes.c_void_p)


@functools.cache
def plants() -> Any:
    """Return the free run of every model, and all of them as one library."""
    found = {
        name: plant_of(model, model.pack(values_of(model)), DT, MARK)
        for name, model in MODELS.items()
    }
    doors = [plant_doors(f'p{k}', plant)[0] for k, plant in enumerate(found.values())]
    return found, library(doors)


@pytest.mark.parametrize('name', MODELS)
@given(seed=st.integers(0, 2**32 - 1), size=st.floats(0.01, 1.0), frequency=st.floats(0.0, 50.0))
@settings(max_examples=2)
def test_a_free_run_has_the_same_bits(name: Any, seed: Any, size: Any, frequency: Any) -> None:
    found, library_of_all = plants()
    place = list(found).index(name)
    step = getattr(library_of_all, f'p{place}_step')
    model = MODELS[name]
    packed = model.pack(values_of(model))
    walk = np.cumsum(np.random.default_rng(seed).standard_normal(300))
    voltage = size * walk / np.abs(walk).max()
    state, answer = model.initial_state(DT), np.zeros(1)
    memory = np.concatenate([(MARK, 0.0, frequency), packed, *state, (0.0,)])
    for k in range(voltage.size):
        with np.errstate(all='ignore'):
            expected = model.respond(
                voltage[k : k + 1], packed, DT, state=state, frequency=frequency
            )[0]
        assert step(at(memory), ctypes.c_double(voltage[k]), at(answer)) == 0
        assert answer[0] == expected or (np.isnan(answer[0]) and np.isnan(expected))


def h_infinity() -> HInfinity:
    plant = hinf.transfer_function([115e-6], [1.0 / (2 * np.pi * 68.0) ** 2, 7e-5, 1.0])
    found = hinf.design(plant, HInfinityWeights(bandwidth=2.0), DT)
    return hinf.HInfinity(found.controller, DT, limits=LIMITS)


GAINS = PidGains(100.0, 3e4, 1.0)
LAWS: dict[str, Callable[[], Any]] = {
    'afc': lambda: attenuation(method='afc', orders=(0, 1, 2, 3, 5), span=0.1, settle=0.05),
    'afc of every order': lambda: attenuation(orders=(-1,), span=0.1, settle=0.05),
    'afc with a resonance': lambda: attenuation(orders=(1,), resonance=68.0, span=0.1),
    'rls': lambda: attenuation(method='rls', orders=(3,)),
    'rls, sines, printed': lambda: attenuation(
        method='rls', orders=(3, 5), fit='sines', sign_rule='printed'
    ),
    'pid': lambda: Pid(GAINS, DT, limits=LIMITS),
    'fuzzy_pid': lambda: FuzzyPid(GAINS, FuzzyRules(5e-6, 1e-3, 50.0, 1e4), DT, limits=LIMITS),
    'h_infinity': h_infinity,
    'h_infinity with little power': h_infinity,
}
ENERGY = {'h_infinity with little power': EnergyLimits(1e-9, 1e-6, 0.05, 2.4)}


def attenuation(**chosen: Any) -> HarmonicAttenuation:
    return HarmonicAttenuation(AttenuationSettings(**chosen), GAIN, DT)


def inverses() -> Iterator[Any]:
    """Return an inverse of every kind for named models, and for chains."""
    kinds = set()
    for law in INVERSES:
        for name in NAMES if law in ('auto', 'tatebatake2017', 'zhou2021') else ():
            model = named(name)
            try:
                link = inverse_for(model, values_of(model), DT, limits=LIMITS, law=law)
            except PiezoError:
                continue
            kind = (type(link), getattr(link, 'law', ''))
            if kind not in kinds:
                kinds.add(kind)
                yield f'{law} of {name}', model, law
    for names in (CHAINS[0], CHAINS[-1]):
        yield f'auto of {"+".join(names)}', MODELS['+'.join(names)], 'auto'


for _name, _model, _law in inverses():
    LAWS[_name] = functools.partial(
        inverse_for, _model, values_of(_model), DT, limits=LIMITS, law=_law
    )


@functools.cache
def loops() -> Any:
    """Return every law before a limiter, and all of them as one library."""
    found, nothing = {}, of_model(Model('', ()), np.zeros(0), ())
    for name, build in LAWS.items():
        link = build()
        if isinstance(link, InverseLink):
            section = inverse_section(link, nothing)
        else:
            section = section_of(link)
        sections = (section, limiter_section(LIMITS, DT))
        found[name] = compensator_of(
            sections, limits_fields(LIMITS, ENERGY.get(name, EnergyLimits())), DT, MARK
        )
    doors = [
        door
        for k, loop in enumerate(found.values())
        for door in compensator_doors(f'c{k}', loop)
        if door.name.endswith(('step', 'init'))
    ]
    return found, library(doors)


def in_turn(*waves: Any) -> Samples:
    """Return the samples of waveforms of 450 ticks each, one after another."""
    parts = [wave.sample(np.arange(450) * DT) for wave in waves]
    columns = zip(*(vars(part).values() for part in parts), strict=True)
    return Samples(*(np.concatenate(rows) for rows in columns))


@pytest.mark.parametrize('name', LAWS)
@given(
    seed=st.integers(0, 2**32 - 1),
    frequency=st.floats(2.0, 60.0),
    amplitude=st.floats(1e-6, 200e-6),
)
@settings(max_examples=2)
def test_a_law_has_the_same_bits(name: Any, seed: Any, frequency: Any, amplitude: Any) -> None:
    found, library_of_all = loops()
    place, loop = list(found).index(name), found[name]
    samples = in_turn(*(Sine(amplitude, f, 0.45, ramp=0.15) for f in (frequency, 62 - frequency)))
    model = named('bouc_wen_mode')
    plant = ModelPlant(model, model.defaults(), DT, noise=1e-8, seed=seed % 1000)
    with np.errstate(all='ignore'):
        run = closed_loop(samples, [LAWS[name]()], plant, LIMITS, DT, ENERGY.get(name))
    memory, numbers = np.full(loop.size, np.nan), np.array([f.value for f in loop.fields])
    if name in ENERGY:
        assert run.counters['limiter']['energy_limited'] > 0
    assert getattr(library_of_all, f'c{place}_init')(at(memory), at(numbers)) == 0
    step, given_in, voltage = getattr(library_of_all, f'c{place}_step'), np.zeros(7), np.zeros(1)
    answers = np.empty(900)
    for k in range(900):
        given_in[:5] = (
            samples.value[k], samples.velocity[k], samples.acceleration[k], samples.frequency[k],
            samples.phase[k],
        )  # fmt: skip
        given_in[5:] = (run.displacement[k - 1] if k else 0.0), 1.0
        assert step(at(memory), at(given_in), at(voltage)) >= 0
        answers[k] = voltage[0]
    np.testing.assert_array_equal(answers, run.voltage)

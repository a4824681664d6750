"""Derivatives that are carried along the path between the ticks."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest

from piezo_hysteresis.blocks import named_block
from piezo_hysteresis.identification.sensitivities import StateOffset, sensitivities
from piezo_hysteresis.models import Model
from piezo_hysteresis.models.simulation.plan import PathStage, free_states
from piezo_hysteresis.models.simulation.state_space import run_path, run_path_four, step_of
from piezo_hysteresis.models.simulation.substep_run import PathRun
from piezo_hysteresis.models.simulation.substep_sensitivities import PathTangents

DT = 1e-3
ORIGIN = 500  # sample at which states are offset
# About where each lies; they are drawn around it.
USUAL = {
    'A1': 180e-6,
    'A': 60e-6,
    'A0': 3e-6,
    'beta': 2.5,
    'gamma': 1.0,
    'natural_frequency': 68.0,
    'damping_ratio': 0.03,
    'mode_cubic': 4e6,
    'mode_friction': 2e-6,
    'presliding': 1e-6,
    'breakaway': 1.3,
    'stribeck_speed': 1e-3,
    'lag_time': 7e-4,
    'slew_rate': 30.0,
    'widening': 0.05,
    'widening_memory': 3e-3,
    'sensor_lag_time': 5e-4,
    'creep_share': 0.1,
    'creep_time': 0.5,
    'cubic_stiffness': 3e6,
    'delay': 4.3e-4,
    'gain_loss': 0.1,
    'resonance_share': 0.1,
    'slow_creep_share': 0.1,
    'z_exponent': 1.5,
    'z_gamma': 800.0,
    'mass': 0.1,
}
CHAINS = (
    ('bouc_wen_exact', 'nonlinear_mode', 'resonance', 'offset'),
    ('bouc_wen_exact', 'nonlinear_mode', 'creep_pair'),
    ('slew_limit', 'bouc_wen_exact', 'nonlinear_mode'),
    ('amplifier_lag', 'bouc_wen_widening', 'mode'),
    ('transport_delay', 'bouc_wen_exact', 'nonlinear_mode', 'sensor_lag'),
    ('bouc_wen_exact', 'mode', 'stiffness', 'resonance'),
    ('bouc_wen_exact', 'mode', 'stiffness', 'gain_decay', 'sensor_lag'),
    ('amplifier_lag', 'bouc_wen_oscillator', 'resonance'),  # interpolates a measured input
)


def drawn(names: tuple[str, ...], seed: int) -> tuple[Model, np.ndarray]:
    """Return a chain with parameters by lot."""
    blocks = tuple(named_block(name) for name in names)
    steps = {q.name for block in blocks for q in block.parameters} & {'interpolation'}
    model = Model('drawn', blocks, dict.fromkeys(steps, 2.0))
    rng = np.random.default_rng(seed)
    values = model.defaults()
    for name in sorted(set(values) & set(USUAL)):
        values[name] = USUAL[name] * rng.uniform(0.8, 1.25)
    values['breakaway'] = max(values.get('breakaway', 1.0), 1.1)
    return model, model.pack({name: values[name] for name in model.parameter_names})


def drive(count: int = 1200) -> np.ndarray:
    t = np.arange(count) * DT
    slow = np.sin(2 * np.pi * 7.0 * t) * np.minimum(5 * t, 1.0)
    return np.asarray(slow + 0.3 * np.sin(2 * np.pi * 31.0 * t))


def central(
    model: Model,
    p: np.ndarray,
    place: int,
    u: np.ndarray,
    share: float,
    offsets: Sequence[StateOffset] = (),
) -> np.ndarray:
    """Return the derivative by central differences on one grid."""
    q = model.parameters[place]
    step = share * max(abs(p[place]), 0.1 * q.scale)
    above, below = p.copy(), p.copy()
    above[place], below[place] = min(p[place] + step, q.high), max(p[place] - step, q.low)
    answers = [run(model, moved, p, u, offsets) for moved in (above, below)]
    return np.asarray((answers[0] - answers[1]) / (above[place] - below[place]))


def run(
    model: Model,
    p: np.ndarray,
    around: np.ndarray,
    u: np.ndarray,
    offsets: Sequence[StateOffset] = (),
) -> np.ndarray:
    """Return the run on the grid of `around`, from states that are offset at `ORIGIN`."""
    signal = u
    for k, (stage, state) in enumerate(zip(model.stages, model.initial_state(DT), strict=True)):
        grid = {}
        if isinstance(stage, PathStage):
            grid = {'steps': stage.run.steps(around[stage.columns], DT)}
        parts: list[np.ndarray] = []
        for part in (signal[:ORIGIN], signal[ORIGIN:]):
            for each in offsets:
                if parts and each.stage == k:
                    state[each.place] += each.amount
            parts.append(
                stage.respond(part, p[stage.columns], DT, state=state, frequency=0.0, **grid)
            )
        signal = np.concatenate(parts)
    return signal


@pytest.mark.component
@pytest.mark.parametrize('seed', [1, pytest.param(2, marks=pytest.mark.slow)])
@pytest.mark.parametrize('names', CHAINS, ids=' '.join)
def test_derivatives_along_a_path_equal_central_differences(names: Any, seed: int) -> None:
    model, p = drawn(names, seed)
    assert any(isinstance(stage, PathStage) for stage in model.stages)
    u = drive()
    y, rows = sensitivities(model, p, model.free_names, u, DT)
    expected = model.respond(u, p, DT)
    np.testing.assert_allclose(y, expected, atol=1e-13 * np.ptp(expected))
    for name, row in zip(model.free_names, rows, strict=True):
        place = model.parameter_names.index(name)
        # large differences bend, small ones round, and what rubs has corners
        missed = []
        for share in (1e-4, 1e-5, 1e-6):
            difference = central(model, p, place, u, share)
            missed.append(np.abs(row - difference).max() / np.abs(difference).max())
        assert min(missed) < 5e-6, name


@pytest.mark.component
@pytest.mark.parametrize(
    'names',
    [*CHAINS[:4], ('transport_delay', 'amplifier_lag', 'bouc_wen_exact', 'mode', 'creep_pair')],
    ids=' '.join,
)
def test_derivatives_from_other_initial_states_equal_central_differences(names: Any) -> None:
    model, p = drawn(names, 5)
    u, offsets = drive(), []
    signal, states = u, model.initial_state(DT)
    for k, (stage, state) in enumerate(zip(model.stages, states, strict=True)):
        signal = stage.respond(signal, p[stage.columns], DT, state=state, frequency=0.0)
        places = free_states(stage, DT)
        offsets += [StateOffset(k, place, 0.2 * abs(state[place]) + 1e-9) for place in places]
    y, rows = sensitivities(model, p, model.free_names, u, DT, origin=ORIGIN, offsets=offsets)
    np.testing.assert_array_equal(y, run(model, p, p, u, offsets))
    for name, row in zip(model.free_names, rows, strict=True):
        place = model.parameter_names.index(name)
        missed = []
        for share in (1e-5, 1e-6, 1e-7):
            difference = central(model, p, place, u, share, offsets)
            missed.append(np.abs(row - difference).max() / np.abs(difference).max())
        assert min(missed) < 1e-4, name


def test_a_parameter_costs_what_is_behind_it_and_not_the_whole_run(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    model, p = drawn(('bouc_wen_exact', 'nonlinear_mode', 'resonance'), 3)
    (stage,) = (stage for stage in model.stages if isinstance(stage, PathStage))

    def respond(*args: Any, **kwargs: Any) -> None:
        raise AssertionError('the whole run was followed once more')

    monkeypatch.setattr(PathRun, 'respond', respond)
    u, own = drive(200), p[stage.columns]
    around = {j: (own[j] * (1 - 1e-6), own[j] * (1 + 1e-6)) for j in (0, 1, 7, 8)}
    run = PathTangents(stage.run, own, around, DT, start=0.0, frequency=0.0, incoming=2)
    _, rows = run.go(u, np.ones((2, u.size)))
    assert rows.shape == (6, u.size)
    # a voltage that is higher throughout is told by that, whoever asks
    np.testing.assert_array_equal(rows[0], rows[1])


def test_chunks_of_a_record_continue_each_other(monkeypatch: pytest.MonkeyPatch) -> None:
    model, p = drawn(('bouc_wen_exact', 'nonlinear_mode', 'stiffness', 'resonance'), 4)
    whole = sensitivities(model, p, model.free_names, drive(), DT)
    monkeypatch.setattr('piezo_hysteresis.models.simulation.substep_sensitivities._VALUES', 700)
    parts = sensitivities(model, p, model.free_names, drive(), DT)
    for one, other in zip(whole, parts, strict=True):
        np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize('many', [1, 3, 4, 6])
def test_paths_side_by_side_have_the_bits_of_one(many: int) -> None:
    block = named_block('creep_pair')
    assert block.system is not None
    step = step_of(block.system(block.pack({**block.defaults(), 'creep_share': 0.1})), DT / 8)
    x = np.random.default_rng(many).normal(size=(many, 240))
    single, together = np.empty_like(x), np.empty_like(x)
    states = np.zeros((many, step.gamma.shape[0]))
    apart = states.copy()
    for row, answer, state in zip(x, single, apart, strict=True):
        run_path(row, answer, state, *step)
    run_path_four(x, together, states, *step)
    np.testing.assert_array_equal(together, single)
    np.testing.assert_array_equal(states, apart)


@pytest.mark.parametrize(
    'names',
    [
        ('amplifier_lag', 'bouc_wen_exact', 'stiffness', 'mode', 'sensor_lag'),
        ('slew_limit', 'bouc_wen_exact', 'mode', 'sensor_lag'),
        ('bouc_wen_exact', 'mode', 'sensor_nonlinearity', 'sensor_lag'),
    ],
    ids=' '.join,
)
def test_a_fast_lag_at_the_end_asks_for_no_finer_steps(names: Any) -> None:
    """It is exact for what comes in: only what shapes its input asks for steps."""
    model, p = drawn(names, 6)
    (stage,) = (stage for stage in model.stages if isinstance(stage, PathStage))
    lag = model.parameter_names.index('sensor_lag_time')
    if 'sensor_nonlinearity' in names:
        p[model.parameter_names.index('sensor_quadratic')] = 300.0
    p[lag] = 0.01 * DT
    fast, state = p[stage.columns], stage.initial_state(DT, 0.0)
    steps = stage.run.steps(fast, DT)
    assert steps == 8
    u = drive()
    found, fine = (
        stage.respond(u, fast, DT, state=state.copy(), frequency=0.0, steps=n)
        for n in (steps, 16 * steps)
    )
    np.testing.assert_allclose(found, fine, atol=3e-5 * np.ptp(fine))


@pytest.mark.parametrize('lag', [0.7, 1e-3])
def test_a_lag_before_a_memory_asks_for_no_finer_steps(lag: float) -> None:
    """Its mean over a step is exact: only what follows asks for steps, however short it is."""
    model, p = drawn(('amplifier_lag', 'bouc_wen_exact', 'mode', 'creep'), 6)
    (stage,) = (stage for stage in model.stages if isinstance(stage, PathStage))
    p[model.parameter_names.index('lag_time')] = lag * DT
    own, state = p[stage.columns], stage.initial_state(DT, 0.0)
    assert stage.run.steps(own, DT) == 4
    found, fine = (
        stage.respond(drive(), own, DT, state=state.copy(), frequency=0.0, steps=n)
        for n in (4, 256)
    )
    np.testing.assert_allclose(found, fine, atol=1e-5 * np.ptp(fine))

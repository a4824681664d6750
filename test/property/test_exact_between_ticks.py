"""Every pair of blocks answers at the ticks as it does when run at 64 times the rate."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
import pytest

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.blocks import BLOCKS
from piezo_hysteresis.blocks.base import Block, InterSample, Slot
from piezo_hysteresis.blocks.parallel import parallel_block
from piezo_hysteresis.models import Model

DT = 1e-3
FINER = 64
TICKS = 160
HELD = (InterSample.INSTANT, InterSample.PATH, InterSample.TICK)
ORDER = {slot: place for place, slot in enumerate(Slot)}
# periods and time constants of the first and the second block in ticks, and what drives them
CASES = ((0.2, 6.0, 'sine'), (6.0, 0.2, 'steps'), (1.0, 50.0, 'triangle'), (50.0, 1.3, 'noise'))
#: Largest difference over the stroke.
EXACT = 1e-4


def voltage(kind: str) -> Any:
    t = np.arange(TICKS) * DT
    if kind == 'sine':
        return np.sin(2 * np.pi * 17.0 * t)
    if kind == 'triangle':
        return 2.0 / np.pi * np.arcsin(np.sin(2 * np.pi * 21.0 * t)) * (1.0 - 4.0 * t)
    if kind == 'steps':
        return np.repeat([0.5, 1.0, -0.4, 0.1, -1.0, 0.7, 0.2, 0.9], TICKS // 8)
    return np.convolve(
        np.random.default_rng(3).standard_normal(TICKS + 7), np.ones(8) / 6, 'valid'
    )


def lively(block: Any, ticks: float, u: Any) -> dict[Any, Any]:
    """Values that show, with the times of the block at `ticks` of a tick."""
    reach = float(np.max(np.abs(u)))
    own = {
        'saturation_high': 0.7 * reach,
        'saturation_low': 0.8 * reach,
        'slew_rate': 0.7 * float(np.max(np.abs(np.diff(u)))) / min(DT, DT * ticks),
        'resonance_share': -0.3,
        'slow_creep_ratio': 5.0,
        'creep_onset': ticks * DT,
        'interpolation': 0.0,
        'presliding': 2e-5,
        'backlash': 7e-6,
        'stiction': 7e-6,
        'mode_cubic': 1e7,
        'mode_friction': 3e-6,
        'cubic_stiffness': 1e7,
        'sensor_quadratic': 800.0,
        'sensor_cubic': 4e6,
        'exponent': 1.6,
        'rate_memory': 3e-3,
        'breakaway': 1.3,
        'stribeck_speed': 5e-3,
    }
    values = {}
    for q in block.parameters:
        value = q.default or 0.7 * q.scale
        if q.unit == 's' and 'memory' not in q.name:
            value = ticks * DT
        if q.unit == 'Hz':
            value = 1.0 / (ticks * DT)
        values[q.name] = min(max(own.get(q.name, value), q.low), q.high)
    if block.name == 'bouc_wen_oscillator':
        values['mass'] = values['stiffness'] * (ticks * DT / (2 * np.pi)) ** 2
        values['damping'] = 0.05 * np.sqrt(values['mass'] * values['stiffness'])
    if block.name == 'mass_spring':
        values['mass'] = values['stiffness'] * (ticks * DT / (2 * np.pi)) ** 2
        values['damping'] = 0.1 * np.sqrt(values['mass'] * values['stiffness'])
    return values


def chain_of(first: Any, second: Any) -> Model:
    # what stands beside a hysteresis is next to nothing alone
    blocks = [
        parallel_block(BLOCKS['bouc_wen_exact'], b) if b.in_parallel else b
        for b in (first, second)
    ]
    if Slot.HYSTERESIS not in (first.slot, second.slot):
        electrical = [b for b in blocks if b.slot is Slot.INPUT]
        force = 'bouc_wen_oscillator' in (first.name, second.name)
        if len(electrical) < 2 and not force:
            blocks.insert(len(electrical), BLOCKS['gain'])
    return Model('pair', tuple(blocks))


def knows_the_tick(block: Block) -> Any:
    """Tell whether a block asks for the rate of the tick or goes from tick to tick."""
    return block.between is InterSample.TICK or (
        block.between is InterSample.PATH
        and block.path_kernel is not None
        and block.name != 'stiction'
    )


def packed(model: Model, first: Any, second: Any, ticks: list[float], u: Any) -> FloatArray:
    values: dict[str, float] = {}
    for block, each in ((first, ticks[0]), (second, ticks[1])):
        values |= {model.names_of(block)[k]: v for k, v in lively(block, each, u).items()}
    recursion = any(name.startswith('autoregressive') for name in model.block_names)
    if recursion and 'A1' in model.parameter_names:
        values['A1'] = 0.1 * values.get('A1', 1.5e-4)  # which it multiplies, and rings
    if first.name == second.name:  # names_of tells the last one
        values |= lively(first, ticks[0], u)
    return model.pack(values, checked=False)


def finely(blocks: tuple[Block, ...], p: np.ndarray, u: Any) -> np.ndarray:
    """Return the output for an input held at 64 times the rate: one more value than that."""
    model = Model('part', tuple(blocks))
    y = model.respond(np.repeat(u, FINER), p, DT / FINER, frequency=17.0)
    return np.concatenate([[0.0], y]) if model.answers_at_once else np.append(y, np.nan)


def truth(model: Model, p: Any, u: Any) -> Any:
    """Return the output at the ticks, or where nothing has inertia at the ends of the ticks."""
    at_once = model.answers_at_once
    counts = np.cumsum([0, *(len(b.parameters) for b in model.blocks)])
    own = [p[a:b] for a, b in itertools.pairwise(counts)]
    held = itertools.takewhile(lambda b: b.between in HELD, model.blocks)
    known = [place for place, block in enumerate(held) if knows_the_tick(block)]
    begin = known[-1] + 1 if known else 0
    for place, block in enumerate(model.blocks[:begin]):
        u = block.respond(u, own[place], DT, state=block.initial_state(DT), frequency=17.0)
    end = len(model.blocks)
    while end > begin and knows_the_tick(model.blocks[end - 1]):
        end -= 1
    if end == begin:
        return u
    fine = finely(model.blocks[begin:end], np.concatenate(own[begin:end]), u)
    readings = fine[FINER::FINER] if at_once else fine[:-1:FINER]
    for block, mine in zip(model.blocks[end:], own[end:], strict=True):
        state = block.initial_state(DT)
        if block.between is InterSample.TICK:
            readings = block.respond(readings, mine, DT, state=state, frequency=17.0)
        else:
            path = np.empty(fine.size - 1)
            assert block.path_kernel is not None
            block.path_kernel(fine[1:], path, state, mine, DT, 17.0, FINER)
            readings = path[FINER - 1 :: FINER]
    return readings


def sensible(first: Block, second: Block) -> bool:
    """Leave out what has no meaning, or not this one."""
    if ORDER[first.slot] > ORDER[second.slot] or first.slot is second.slot is Slot.HYSTERESIS:
        return False
    if second.name == 'bouc_wen_oscillator' and first.slot is not Slot.INPUT:
        return False  # it takes a force
    # a forward Euler step is right to first order only: behind what moves that is what shows
    euler = 'forward euler' in second.description.lower()
    return not (euler and first.between in (InterSample.LINEAR, InterSample.INNER))


PAIRS = [
    pytest.param(first, second, id=f'{first.name}-{second.name}')
    for first in BLOCKS.values()
    for second in BLOCKS.values()
    if sensible(first, second)
]


@pytest.mark.parametrize(('first', 'second'), PAIRS)
def test_a_pair_is_exact_between_the_ticks(first: Any, second: Any) -> None:
    model = chain_of(first, second)
    for *ticks, kind in CASES:
        u = voltage(kind)
        p = packed(model, first, second, ticks, u)
        y, expected = model.respond(u, p, DT, frequency=17.0), truth(model, p, u)
        error = np.abs(y - expected)
        if 'stiction' in model.block_names:  # which jumps, now and then on the next tick
            error = np.sort(error)[: -TICKS // 20]
        worst = float(np.max(error)) / float(np.ptp(expected))
        assert worst < EXACT, (ticks, kind)


CHAINS = (
    ('amplifier_lag', 'bouc_wen_exact', 'mode'),
    ('slew_limit', 'bouc_wen_exact', 'mode_pair', 'creep'),
    ('transport_delay', 'amplifier_lag', 'square_law', 'prandtl_ishlinskii', 'mode'),
    ('transport_delay', 'slew_limit', 'preisach', 'resonance', 'sensor_lag'),
    ('transport_delay', 'bouc_wen_exact', 'mode', 'backlash', 'creep'),
    (
        'amplifier_lag',
        'slew_limit',
        'bouc_wen_power',
        'nonlinear_mode',
        'gain_decay',
        'sensor_lag',
    ),
)


@pytest.mark.slow
@pytest.mark.parametrize('names', CHAINS, ids='-'.join)
def test_a_longer_chain_is_exact_between_the_ticks(names: Any) -> None:
    model = Model('chain', tuple(BLOCKS[name] for name in names))
    for *ticks, kind in (*CASES, (6.0, 6.0, 'sine'), (2.5, 9.0, 'steps')):
        values: dict[str, float] = {}
        u = voltage(kind)
        for i, block in enumerate(model.blocks):
            values |= lively(block, ticks[i % 2], u)
        p = model.pack(values, checked=False)
        y, expected = model.respond(u, p, DT), truth(model, p, u)
        assert np.max(np.abs(y - expected)) < 3.0 * EXACT * np.ptp(expected), (ticks, kind)

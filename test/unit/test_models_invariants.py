"""What holds for every registered block and every named model, one list for all of them."""

from __future__ import annotations

import itertools
import re
from typing import Any

import numpy as np
import pytest

from piezo_hysteresis import models
from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.blocks import BLOCKS, Slot, named_block
from piezo_hysteresis.blocks.base import Block, InterSample
from piezo_hysteresis.models import Model

DT = 1e-3
FREQUENCY = 23.0

# Blocks along whose path time does not matter: none of their numbers has a time in its unit.
RATE_INDEPENDENT = [
    name
    for name, block in BLOCKS.items()
    if block.between in (InterSample.INSTANT, InterSample.PATH)
    and block.slot in (Slot.INPUT, Slot.HYSTERESIS, Slot.STRUCTURE)
    and 'forward euler' not in block.description.lower()  # its step is the sampling interval
    and not any(set(re.findall('[a-zA-Z]+', q.unit)) & {'s', 'Hz', 'N'} for q in block.parameters)
]
# Hystereses answer in metres: they grow with what is in metres of theirs, all together.
HOMOGENEOUS = {
    name: tuple(q.name for q in block.parameters if q.unit.startswith('m'))
    for name, block in BLOCKS.items()
    if block.slot is Slot.HYSTERESIS
    and any(q.unit.startswith('m') for q in block.parameters)
    and not any('/m' in q.unit for q in block.parameters)
}


def lively(block_or_model: Any) -> Any:
    """Parameters with which every path of the kernel is taken: none neutral, none at a bound."""
    values = {}
    for q in block_or_model.parameters:
        if q.held:
            values[q.name] = q.default
        elif q.default == 0.0 or q.default >= 1e5:
            values[q.name] = min(max(0.7 * q.scale, q.low), q.high)
        else:
            values[q.name] = q.default
    return block_or_model.pack(values)


def signal_for(block: Block, n: int = 3000) -> Any:
    """Return nested loops, a pause and a jump, in the unit of the slot."""
    t = np.arange(n) * DT
    wave = np.sin(2 * np.pi * FREQUENCY * t) * (1 - 0.6 * t / t[-1])
    wave += 0.3 * np.sin(2 * np.pi * 3.1 * t)
    wave[n // 2 : n // 2 + 60] = wave[n // 2]
    wave[2 * n // 3] += 0.4
    electrical = block.slot in ('input', 'hysteresis') or block.name == 'bouc_wen_oscillator'
    return wave if electrical else 1e-4 * wave


@pytest.mark.parametrize('name', BLOCKS)
def test_one_sample_at_a_time_gives_the_same_bits(name: Any) -> None:
    block = BLOCKS[name]
    x, p = signal_for(block, 600), lively(block)
    whole = block.respond(x, p, DT, state=block.initial_state(DT, 0.3), frequency=FREQUENCY)
    state = block.initial_state(DT, 0.3)
    single = [
        block.respond(x[k : k + 1], p, DT, state=state, frequency=FREQUENCY)[0]
        for k in range(x.size)
    ]
    np.testing.assert_array_equal(single, whole)
    assert np.isfinite(whole).all()
    assert np.ptp(whole) > 0


@pytest.mark.parametrize('name', BLOCKS)
def test_any_chunks_give_the_whole(name: Any) -> None:
    block = BLOCKS[name]
    x, p = signal_for(block), lively(block)
    whole = block.respond(x, p, DT, state=block.initial_state(DT), frequency=FREQUENCY)
    state = block.initial_state(DT)
    chunks = [
        block.respond(part, p, DT, state=state, frequency=FREQUENCY)
        for part in np.split(x, [1, 2, 500, 1777])
    ]
    np.testing.assert_array_equal(np.concatenate(chunks), whole)


@pytest.mark.parametrize(
    'name', [n for n, b in BLOCKS.items() if b.between in (InterSample.LINEAR, InterSample.INNER)]
)
def test_with_inertia_a_position_does_not_depend_on_the_input_of_its_tick(name: Any) -> None:
    block = BLOCKS[name]
    p = lively(block)
    for place, q in enumerate(block.parameters):
        p[place] = 0.0 if q.name == 'interpolation' else p[place]  # a held input
    x = signal_for(block, 40)
    one, other = (
        block.respond(each, p, DT, state=block.initial_state(DT))
        for each in (x, np.append(x[:-1], -x[-1]))
    )
    np.testing.assert_array_equal(one[:-1], other[:-1])
    assert bool(one[-1] == other[-1]) is block.inertia


@pytest.mark.parametrize('name', [n for n, b in BLOCKS.items() if b.slot is Slot.HYSTERESIS])
def test_what_gives_nothing_by_default_is_added_to_a_hysteresis(name: Any) -> None:
    block = BLOCKS[name]
    y = block.respond(signal_for(block, 60), block.pack({}), DT, state=block.initial_state(DT))
    assert block.in_parallel is not bool(np.any(y))


@pytest.mark.parametrize('name', models.NAMES)
def test_models_answer_alike_whole_and_stepwise(name: Any) -> None:
    model = models.named(name)
    x, p = signal_for(model.blocks[0], 600), lively(model)
    whole = model.respond(x, p, DT, frequency=FREQUENCY)
    state = model.initial_state(DT)
    single = [
        model.respond(x[k : k + 1], p, DT, state=state, frequency=FREQUENCY)[0]
        for k in range(x.size)
    ]
    np.testing.assert_array_equal(single, whole)
    assert np.ptp(whole) > 0


@pytest.mark.parametrize(
    'names',
    [
        ('bouc_wen_exact', 'mode', 'creep', 'sensor_lag', 'offset'),
        ('transport_delay', 'bouc_wen_exact', 'mode_pair', 'creep_pair'),
        ('amplifier_lag', 'bouc_wen_exact', 'mode'),
        ('transport_delay', 'slew_limit', 'bouc_wen_rate', 'nonlinear_mode', 'backlash', 'warming',
         'logarithmic_creep', 'mains_hum'),
        ('amplifier_lag', 'prandtl_ishlinskii', 'stiction', 'resonance', 'harmonic3'),
        ('transport_delay', 'amplifier_lag', 'bouc_wen_oscillator', 'stiffness', 'sensor_lag'),
    ],
)  # fmt: skip
def test_chains_that_move_between_the_ticks_answer_alike_whole_and_stepwise(
    names: tuple[str, ...],
) -> None:
    model = Model('chain', tuple(named_block(name) for name in names))
    x, p = signal_for(model.blocks[0], 300), lively(model)
    assert any(len(stage.blocks) > 1 for stage in model.stages)
    whole = model.respond(x, p, DT, frequency=FREQUENCY, state=model.initial_state(DT, 0.3))
    state = model.initial_state(DT, 0.3)
    single = [
        model.respond(x[k : k + 1], p, DT, state=state, frequency=FREQUENCY)[0]
        for k in range(x.size)
    ]
    np.testing.assert_array_equal(single, whole)
    assert np.isfinite(whole).all()
    assert np.ptp(whole) > 0


@pytest.mark.parametrize('name', RATE_INDEPENDENT)
def test_time_does_not_matter_to_rate_independent_blocks(name: Any) -> None:
    """The answer at the reversals is the same however many samples lie between them."""
    block = BLOCKS[name]
    p = lively(block)
    size = 1.0 if block.slot == 'hysteresis' else 1e-4
    reversals = size * np.array([0.0, 0.9, -0.7, 0.5, -0.95, 0.2, 0.1, 0.98])

    def at_reversals(samples: int, dt: Any) -> FloatArray:
        path = [np.linspace(a, b, samples + 1)[1:] for a, b in itertools.pairwise(reversals)]
        y = block.respond(np.concatenate(path), p, dt, state=block.initial_state(dt))
        return y[samples - 1 :: samples]

    coarse, fine = at_reversals(40, DT), at_reversals(640, 7 * DT)
    # the exponent is integrated, stiction jumps where a sample happens to lie
    tolerance = {'bouc_wen_power': 1e-4, 'stiction': 5e-2}.get(name, 1e-11)
    np.testing.assert_allclose(coarse, fine, atol=tolerance * np.ptp(fine), rtol=0)


@pytest.mark.parametrize('name', HOMOGENEOUS)
def test_blocks_are_homogeneous_in_their_weights(name: Any) -> None:
    block = BLOCKS[name]
    x, p = signal_for(block), lively(block)
    scaled = p.copy()
    for i, q in enumerate(block.parameters):
        if q.name in HOMOGENEOUS[name]:
            scaled[i] *= 3.0
    y = block.respond(x, p, DT, state=block.initial_state(DT))
    y3 = block.respond(x, scaled, DT, state=block.initial_state(DT))
    np.testing.assert_allclose(y3, 3.0 * y, rtol=0, atol=1e-12 * np.ptp(y3))


def test_shared_parameter_names_mean_the_same_thing() -> None:
    units: dict[str, str] = {}
    for block in BLOCKS.values():
        for q in block.parameters:
            assert units.setdefault(q.name, q.unit) == q.unit, q.name
            assert q.low <= q.default <= q.high, q.name
            assert q.description.endswith('.'), q.name
            assert q.scale > 0, q.name


def test_blocks_side_by_side_add_up() -> None:
    joined = named_block('bouc_wen_exact|electrostriction')
    x = signal_for(joined)
    a, b = named_block('bouc_wen_exact'), named_block('electrostriction')
    pa, pb = lively(a), lively(b)
    y = joined.respond(x, np.concatenate([pa, pb]), DT, state=joined.initial_state(DT))
    expected = a.respond(x, pa, DT, state=a.initial_state(DT))
    expected = expected + b.respond(x, pb, DT, state=b.initial_state(DT))
    np.testing.assert_array_equal(y, expected)
    assert Model('joined', (joined,)).block_names == ('bouc_wen_exact', 'electrostriction')


@pytest.mark.parametrize('name', models.NAMES)
def test_models_scale_with_the_actuator(name: Any) -> None:
    """A model for 150 V and 20 um is the bimorph's in other units."""
    small, large = models.named(name), models.for_range(models.named(name), 150.0, 20e-6)
    x = signal_for(small.blocks[0], 1500)
    y = small.respond(x, small.pack({}), DT, frequency=0.0)
    scaled = large.respond(150.0 * x, large.pack({}), DT, frequency=0.0)
    np.testing.assert_allclose(scaled / 20e-6, y / 130e-6, rtol=0, atol=1e-9)


@pytest.mark.parametrize('name', [*models.NAMES, 'classical+electrostriction+mode'])
def test_every_parameter_of_a_chain_belongs_to_a_block(name: str) -> None:
    chain = models.named(name)
    owned = [each for block in chain.blocks for each in chain.names_of(block).values()]
    assert sorted(owned) == sorted(chain.parameter_names)

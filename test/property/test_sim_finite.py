"""Whatever the parameters within their bounds and the commands: the state stays finite."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from piezo_sim import Plant, PlantError
from piezo_sim.parts.chain import GRID
from piezo_sim.plant_parameters import PlantParameter

TABLE = Plant().parameter_table
EFFECTS = [row.name for row in Plant().effect_table]
QUICK = settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.too_slow])


def _inside(row: PlantParameter) -> Any:
    """Values over the whole range of a parameter, near its default more often."""
    if row.low > 0.0 or row.low == 0.0:
        low, high = max(row.low, 1e-6 * (abs(row.default) or 1.0)), row.high
        return st.floats(math.log(low), math.log(high)).map(
            lambda x: min(max(math.exp(x), low), high)
        )
    return st.floats(row.low, row.high)


SOME = st.lists(st.sampled_from(TABLE), max_size=6, unique=True).flatmap(
    lambda rows: st.fixed_dictionaries({row.name: _inside(row) for row in rows})
)
ON = st.sets(st.sampled_from(EFFECTS), max_size=8)
COMMANDS = st.lists(
    st.one_of(st.floats(-1.5, 1.5), st.floats(allow_nan=True, allow_infinity=True)),
    min_size=1,
    max_size=40,
)


def _finite(plant: Plant) -> None:
    state = plant.snapshot().state
    for name in state.dtype.names or ():
        values = state[name]
        if values.dtype.kind == 'f':
            assert np.all(np.isfinite(values)), name
    assert np.all(np.isfinite(plant.snapshot().history))


def _install(plant: Plant, changes: dict[Any, Any]) -> bool:
    try:
        plant.set_parameters(changes)
    except PlantError:
        return False
    return True


@QUICK
@given(first=SOME, second=SOME, on=ON, other=ON, commands=COMMANDS, seed=st.integers(0, 2**63))
def test_the_state_never_becomes_nan(
    first: Any, second: Any, on: Any, other: Any, commands: Any, seed: Any
) -> None:
    plant = Plant(seed=seed)
    _install(plant, {**first, **{f'effects.{name}': True for name in on}})
    readings = [plant.exchange(v) for v in commands]
    _install(plant, {**second, **{f'effects.{name}': name in other for name in EFFECTS}})
    readings += [plant.exchange(v) for v in commands]
    _finite(plant)
    assert np.all(np.isfinite(readings))


@QUICK
@given(on=ON, commands=st.lists(st.floats(-1.2, 1.2), min_size=2, max_size=60),
       cut=st.integers(0, 60), seed=st.integers(0, 2**63))  # fmt: skip
def test_arrays_and_single_samples_agree_for_any_set_of_effects(
    on: Any, commands: Any, cut: Any, seed: Any
) -> None:
    plant = Plant(seed=seed)
    _install(plant, {f'effects.{name}': True for name in on})
    whole = plant.run(commands)
    plant.reset()
    single = [plant.exchange(v) for v in commands[:cut]]
    rest = plant.run(commands[cut:])
    np.testing.assert_array_equal(np.concatenate([single, rest]), whole)


@QUICK
@given(delay=st.floats(0.0, 0.1), rate=st.sampled_from([100.0, 1000.0, 7777.0]))
def test_any_delay_delays_by_itself(delay: Any, rate: Any) -> None:
    plant = Plant({'effects.transport_delay': True, 'amplifier.delay': delay}, rate=rate)
    count = math.ceil(delay * rate) + 2
    readings = plant.run(np.ones(count + 1))
    # A reading is taken before what arrives at its tick.
    assert np.argmax(readings > 0.0) == int(delay * rate * GRID + 0.5) // GRID + 1


@QUICK
@given(values=st.lists(st.floats(-1.0, 1.0), min_size=2, max_size=40),
       law=st.sampled_from(['play', 'preisach']))  # fmt: skip
def test_every_closed_cycle_of_the_voltage_loses_energy_and_closes(values: Any, law: Any) -> None:
    """A second run through the same cycle returns to the same point, with a loss."""
    plant = Plant({f'effects.{law}': True})
    cycle = [*values, values[0]]
    plant.run([1.0, -1.0, *cycle, *cycle])
    before = plant.displacement
    work, last = 0.0, values[0]
    for v in cycle:
        start = plant.displacement
        for step in np.linspace(last, v, 9)[1:]:
            plant.exchange(float(step))
            work += 0.5 * (start + plant.displacement) * (step - last)
            start, last = plant.displacement, step
    assert plant.displacement == pytest.approx(before, abs=1e-15)
    assert work <= 1e-12

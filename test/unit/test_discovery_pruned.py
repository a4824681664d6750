"""An effect that only helped another to its place does not stay in the model."""

from __future__ import annotations

import pytest

from piezo_hysteresis.discovery.arena import Arena, added_of
from piezo_hysteresis.discovery.baseline import baselines
from piezo_hysteresis.discovery.dataset import split
from piezo_hysteresis.discovery.trial import Trial, on_views
from piezo_hysteresis.models import add_effect, described, named
from piezo_sim.sweep import simulate

HIDDEN = {
    'effects.resonance': True,
    'structure.natural_frequency': 120.0,
    'structure.damping_ratio': 0.05,
}
RESONANCE = {'resonance_frequency': 120.0, 'resonance_damping': 0.05, 'resonance_share': 1.0}
Scene = tuple[Arena, Trial]


@pytest.fixture(scope='module')
def scene() -> Scene:
    plan = [
        {'kind': 'sine', 'frequency': f, 'amplitude': 1.0, 'duration': 1.0} for f in (2, 7, 19, 43)
    ]
    data = split(simulate('generic_bouc_wen', plan, HIDDEN, 2))
    arena = Arena(data, 0, 1)
    return arena, baselines(data, named('classical')).joint


def given(arena: Arena, trial: Trial, name: str, variant: str, values: dict[str, float]) -> Trial:
    """Return the model of `trial` with an effect of these values, not fitted."""
    effect = next(e for e in described(name) if e.variant == variant)
    found = add_effect(trial.model, effect)
    known = found.values(trial.values, {found.renamed[k]: v for k, v in values.items()})
    parts, late = (*trial.added, added_of(found)), trial.sampling_offset
    bare = Trial(found.model, known, (), trial.parameters + 1, parts, sampling_offset=late)
    return on_views(bare, arena.views)


def test_what_changes_nothing_goes_and_takes_what_it_made_needless_along(scene: Scene) -> None:
    arena, start = scene
    once = arena.refit(given(arena, start, 'resonance', 'resonance', RESONANCE))
    assert once.rms < 1.1 * arena.floor
    twice = given(arena, once, 'resonance', 'resonance', {**RESONANCE, 'resonance_share': 0.0})
    thrice = given(arena, twice, 'amplifier_lag', 'sensor_lag', {'sensor_lag_time': 0.0})
    pruned = arena.pruned(thrice, start)
    assert [added.effect for added in pruned.added] == ['resonance']
    assert pruned.values['resonance_frequency'] == pytest.approx(120.0, rel=1e-3)
    assert pruned.rms < 1.1 * arena.floor


def test_what_is_needed_stays_untouched(scene: Scene) -> None:
    arena, start = scene
    lag = given(arena, start, 'amplifier_lag', 'sensor_lag', {'sensor_lag_time': 0.0})
    both = arena.refit(given(arena, lag, 'resonance', 'resonance', RESONANCE))
    assert arena.pruned(both, start) is both


def test_an_effect_that_freed_a_parameter_can_be_taken_out(scene: Scene) -> None:
    arena, start = scene
    once = arena.refit(given(arena, start, 'resonance', 'resonance', RESONANCE))
    (variant,) = {e.variant for e in described('asymmetry') if 'A0' in e.frees}
    twice = given(arena, once, 'asymmetry', variant, {'A0': 1e-12})
    pruned = arena.pruned(twice, start)
    assert [added.effect for added in pruned.added] == ['resonance']
    assert pruned.values['A0'] == start.values['A0'] == 0.0

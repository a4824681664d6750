"""Halving every integration step changes the output by less than 1e-6 of the stroke."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from sim_signals import sine

from piezo_sim import Plant, preset_names

# What is random or a threshold turns a change in the last digit into a step; it has no step error.
DISCRETE = ('quantisation', 'dac_quantisation', 'switching')
EFFECTS = [row.name for row in Plant().effect_table if row.name not in DISCRETE]
STILL = {f'effects.{name}': False for name in ('noise', 'quantisation')}

WORLDS = {
    'static': {'effects.bouc_wen': True},
    'resonant': {'effects.bouc_wen': True, 'effects.resonance': True},
    'lagged': {'effects.play': True, 'effects.resonance': True, 'effects.amplifier_lag': True},
}


def _command(voltage: float, bias: float, rate: Any, seconds: float = 1.5) -> Any:
    """Slow, fast and small motion, a step, a hold and ringing afterwards."""
    time, slow = sine(7.0, 0.55 * voltage, seconds, rate)
    command = slow + 0.4 * voltage * np.sin(2 * np.pi * 23.0 * time + 1.0)
    command[time > 0.5] = 0.9 * voltage * np.sin(2 * np.pi * 40.0 * time[time > 0.5])
    command[time > 1.0] = 0.5 * voltage
    return bias + command


def _change(make: Callable[..., Any], command: Any) -> Any:
    coarse, fine = (make(refine).run(command) for refine in (0, 1))
    return np.abs(coarse - fine).max() / np.ptp(fine)


@pytest.mark.parametrize('lag', [False, True])
@pytest.mark.parametrize('name', preset_names())
def test_presets_do_not_depend_on_the_step(name: Any, lag: bool) -> None:
    def make(refine: int) -> Plant:
        overrides = {**STILL, 'effects.amplifier_lag': lag}
        return Plant.from_preset(name, overrides=overrides, refine=refine)

    preset = make(0).preset
    assert _change(make, _command(preset.voltage, preset.bias, preset.rate, 1.2)) < 1e-6


@pytest.mark.parametrize('world', WORLDS)
@pytest.mark.parametrize('effect', EFFECTS)
def test_effects_do_not_depend_on_the_step(effect: Any, world: Any) -> None:
    overrides = {**WORLDS[world], f'effects.{effect}': True}
    assert _change(lambda n: Plant(overrides, refine=n), _command(1.0, 0.0, 1000.0)) < 1e-6


def test_the_refinement_is_a_finer_integration() -> None:
    """A pair of runs that agree because nothing was refined would prove nothing."""
    overrides = {'effects.resonance': True, 'effects.friction': True}
    assert _change(lambda n: Plant(overrides, refine=n), _command(1.0, 0.0, 1000.0)) > 0.0

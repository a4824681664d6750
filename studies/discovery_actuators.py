"""Actuators of random numbers, each described in full by a named model, for the blind proof."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

Generator = np.random.Generator
Overrides = dict[str, float | bool]


@dataclass(frozen=True)
class World:
    """An actuator without anything hidden.

    Attributes
    ----------
    name : str
        Kind of world.
    baseline : str
        Named model that describes it.
    overrides : dict
        Parameters and switches of the simulator.
    absorbed : tuple of str
        Parameters of the simulator that a refit of the baseline stands for.
    """

    name: str
    baseline: str
    overrides: Overrides
    absorbed: tuple[str, ...]


def sign(rng: Generator) -> float:
    """Draw -1 or 1."""
    return float(rng.choice([-1.0, 1.0]))


def share(rng: Generator, low: float, high: float) -> float:
    """Draw a number whose logarithm is uniform between those of `low` and `high`."""
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def bouc_wen(rng: Generator) -> Overrides:
    """Draw a classical Bouc-Wen loop."""
    beta = share(rng, 0.5, 3.0)
    return {
        'actuator.gain': share(rng, 0.7e-4, 2e-4),
        'bouc_wen.alpha': float(rng.uniform(0.25, 0.6)),
        'bouc_wen.beta': beta,
        'bouc_wen.gamma': beta * float(rng.uniform(-0.5, 0.8)),
    }


def mode(rng: Generator) -> Overrides:
    """Draw a mode of vibration."""
    return {
        'effects.resonance': True,
        'structure.natural_frequency': share(rng, 55.0, 280.0),
        'structure.damping_ratio': share(rng, 0.01, 0.08),
    }


def play(rng: Generator) -> Overrides:
    """Draw a bank with thresholds at tenths of the range, nine operators."""
    weights = rng.exponential(1.0, 9)
    weights *= rng.uniform(0.2, 0.4) / weights.sum()
    bank: Overrides = {'effects.bouc_wen': False, 'effects.play': True}
    for j in range(12):
        bank[f'play.radius_{j + 1:02}'] = 0.1 * (j + 1) if j < 9 else 1.0
        bank[f'play.weight_{j + 1:02}'] = float(weights[j]) if j < 9 else 0.0
    return {**bank, 'actuator.gain': share(rng, 0.7e-4, 2e-4)}


_OWN = ('actuator.gain', 'bouc_wen.alpha', 'bouc_wen.beta', 'bouc_wen.gamma')
_MODAL = ('structure.natural_frequency', 'structure.damping_ratio')


def world(name: str, rng: Generator) -> World:
    """Draw the numbers of a kind of world."""
    if name == 'static':
        return World(name, 'classical', bouc_wen(rng), _OWN)
    if name == 'off_centre':
        own = bouc_wen(rng) | {'effects.asymmetry': True}
        own['bouc_wen.asymmetry'] = sign(rng) * float(rng.uniform(0.02, 0.15))
        return World(name, 'modified', own, (*_OWN, 'bouc_wen.asymmetry'))
    if name == 'mode':
        return World(name, 'bouc_wen_mode', bouc_wen(rng) | mode(rng), (*_OWN, *_MODAL))
    if name == 'linear':
        own = {'effects.bouc_wen': False, 'actuator.gain': share(rng, 0.7e-4, 2e-4)} | mode(rng)
        return World(name, 'linear_mode', own, ('actuator.gain', *_MODAL))
    if name == 'play':
        weights = tuple(f'play.weight_{j:02}' for j in range(1, 10))
        return World(name, 'prandtl_ishlinskii', play(rng), ('actuator.gain', *weights))
    raise ValueError(f'there is no world {name}')

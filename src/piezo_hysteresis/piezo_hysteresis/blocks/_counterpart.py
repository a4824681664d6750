"""Parameter names of blocks in the simulator node, to transfer an identified model to it.

The simulator has separate equations and parameters. The trait `counterpart` of a block maps its
parameters to the equivalent ones of the simulator.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

SimulatorValues = dict[str, float | bool]
Counterpart = Callable[[Mapping[str, float]], SimulatorValues]


def switched(effect: str, **names: str) -> Counterpart:
    """Return a one-to-one mapping that enables an effect of the simulator.

    Parameters
    ----------
    effect : str
        Name of the effect in the simulator.
    **names : str
        Parameter of the block, and that of the simulator with ``__`` for the dot.
    """

    def counterpart(values: Mapping[str, float]) -> SimulatorValues:
        return {
            f'effects.{effect}': True,
            **{theirs.replace('__', '.'): values[ours] for ours, theirs in names.items()},
        }

    return counterpart


def bouc_wen(values: Mapping[str, float]) -> SimulatorValues:
    """Return the simulator parameters of an off-centre Bouc-Wen hysteresis."""
    gain = values['A1']
    found: SimulatorValues = {
        'effects.bouc_wen': True,
        'actuator.gain': gain,
        'bouc_wen.alpha': values['A'] / gain,
        'bouc_wen.beta': values['beta'],
        'bouc_wen.gamma': values['gamma'],
        'effects.asymmetry': values.get('A0', 0.0) != 0.0,
    }
    if values.get('A0', 0.0) != 0.0:
        found['bouc_wen.asymmetry'] = values['A0'] / gain
    return found


def first_mode(values: Mapping[str, float]) -> SimulatorValues:
    """Return the simulator parameters of the mode in series with the whole displacement."""
    return {
        'effects.resonance': True,
        'structure.natural_frequency': values['natural_frequency'],
        'structure.damping_ratio': values['damping_ratio'],
    }


def second_mode(values: Mapping[str, float]) -> SimulatorValues:
    """Return the simulator parameters of a mode with a share of the displacement."""
    return {
        'effects.second_mode': True,
        'mode_2.frequency': values['resonance_frequency'],
        'mode_2.damping_ratio': values['resonance_damping'],
        'mode_2.share': values['resonance_share'],
    }

"""What blocks are called in the simulator node, so that a running simulator gets what was found.

The simulator has its own physics and its own numbers. A block says which of them mean the same by
its trait `counterpart`; that is a matter of names, and nothing is computed from it here.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

SimulatorValues = dict[str, float | bool]
Counterpart = Callable[[Mapping[str, float]], SimulatorValues]


def switched(effect: str, **names: str) -> Counterpart:
    """Return a translation one to one that switches an effect of the simulator on.

    Parameters
    ----------
    effect : str
        Its name there.
    **names : str
        Our parameter to that of the simulator, with ``__`` for the dot.
    """

    def counterpart(values: Mapping[str, float]) -> SimulatorValues:
        return {
            f'effects.{effect}': True,
            **{theirs.replace('__', '.'): values[ours] for ours, theirs in names.items()},
        }

    return counterpart


def bouc_wen(values: Mapping[str, float]) -> SimulatorValues:
    """Return an off-centre Bouc-Wen hysteresis, its shares over the gain."""
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
    """Return the mode that carries the whole motion."""
    return {
        'effects.resonance': True,
        'structure.natural_frequency': values['natural_frequency'],
        'structure.damping_ratio': values['damping_ratio'],
    }


def second_mode(values: Mapping[str, float]) -> SimulatorValues:
    """Return a mode that carries a share of the motion."""
    return {
        'effects.second_mode': True,
        'mode_2.frequency': values['resonance_frequency'],
        'mode_2.damping_ratio': values['resonance_damping'],
        'mode_2.share': values['resonance_share'],
    }

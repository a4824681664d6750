"""Additional thresholds for the selection of a model for prediction."""

from __future__ import annotations

from dataclasses import dataclass

from piezo_hysteresis.discovery.selection.policy import POLICY, number


@dataclass(frozen=True)
class ChoicePolicy:
    """Thresholds in addition to `FITS`; fields have ``metadata`` as those of `SelectionPolicy`."""

    trained: float = number(
        0.7,
        '1',
        'Share of each record that is fitted; the rest is held out.',
        'chosen: usual in other tools',
    )
    min_gain: float = number(
        0.02,
        '1',
        'Share by which an effect must lower the fitted or the held-out error.',
        'chosen: less has no effect on tracking',
    )
    min_standard_errors: float = number(
        3.0,
        'standard deviations',
        'Joint deviation of the parameters of an effect from their neutral values.',
        'derived: one in 370 of a normal distribution; held-out data are also tested',
    )
    inner_loops: float = number(
        1.25,
        '1',
        'Held-out error of play operators, relative to Bouc-Wen, up to which they are selected: '
        'their inner loops close as in actuators, which records of few amplitudes do not show.',
        'chosen: accepts a quarter more error for loops that were not recorded',
    )
    one_level: float = number(
        0.8,
        '1',
        'Smallest reversal level, relative to the largest, of a voltage that counts as one '
        'amplitude.',
        'chosen: closer loops look alike',
    )
    rough: float = number(1e-4, '1', 'Relative change at which a trial stops.', 'effort')


CHOICE = ChoicePolicy()
#: Evaluations of the fits, and the accepted increase of the held-out error.
FITS = POLICY.but(first_evaluations=10, final_evaluations=80, worse=0.01)

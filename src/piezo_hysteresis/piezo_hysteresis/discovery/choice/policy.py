"""Every number by which a model is chosen that shall predict, besides those of discovery."""

from __future__ import annotations

from dataclasses import dataclass

from piezo_hysteresis.discovery.selection.policy import POLICY, number


@dataclass(frozen=True)
class ChoicePolicy:
    """What decides beside `FITS`; each field has ``metadata`` as those of `SelectionPolicy`."""

    trained: float = number(
        0.7,
        '1',
        'Share of each record that is fitted; the rest decides.',
        'chosen: what a user of other tools expects',
    )
    min_gain: float = number(
        0.02,
        '1',
        'Share by which an effect must lower the error, on what is fitted or on the rest.',
        'chosen: less is not seen in a loop',
    )
    min_standard_errors: float = number(
        3.0,
        'standard deviations',
        'By which the parameters of an effect together must differ from none.',
        'derived: one in 370 of a normal distribution; held-out data judge besides',
    )
    inner_loops: float = number(
        1.25,
        '1',
        'Held-out error of plays, over that of Bouc-Wen, up to which plays are taken: their inner '
        'loops close as those of actuators do, which records of few amplitudes do not show.',
        'chosen: a quarter of the error against every loop that was not recorded',
    )
    one_level: float = number(
        0.8,
        '1',
        'Share of the largest level to which the voltage turns back at least where it has one '
        'amplitude.',
        'chosen: loops within less of each other look alike',
    )
    rough: float = number(1e-4, '1', 'Relative change at which a trial ends.', 'effort')


CHOICE = ChoicePolicy()
#: Evaluations of the fits, and by how much held-out errors may grow, in the words of discovery.
FITS = POLICY.but(trial_evaluations=4, first_evaluations=10, final_evaluations=80, worse=0.01)

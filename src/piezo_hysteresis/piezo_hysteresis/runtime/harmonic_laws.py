"""The attenuation of harmonics that the parameters of its node describe."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import fields
from typing import Any

from piezo_hysteresis.compensation.harmonics.attenuation import (
    AttenuationSettings,
    HarmonicAttenuation,
)
from piezo_hysteresis.compensation.linear_gain import ModeGain
from piezo_hysteresis.runtime.laws import Law

# The settings of the law are parameters under the same names.
_SETTINGS = tuple(field.name for field in fields(AttenuationSettings))


class HarmonicLaws:
    """Makes attenuations of harmonics, see `LawMaker`."""

    def build(self, values: Mapping[str, Any], dt: float) -> Law | None:
        """Return the law with the settings of `values`; None where it is not enabled."""
        settings = {name: values[name] for name in _SETTINGS}
        settings['orders'] = tuple(settings['orders'])
        law = HarmonicAttenuation(AttenuationSettings(**settings), _gain(values), dt)
        return law if values['enabled'] else None

    def shapes(self, values: Mapping[str, Any], name: str) -> bool:
        """Return whether `name` is a setting of the law."""
        return name in _SETTINGS or name == 'enabled' or name.startswith('plant.')

    def adjust(self, law: Law | None, values: Mapping[str, Any], changed: Collection[str]) -> bool:
        """Take a new model of the plant gain without forgetting the correction."""
        if not all(name.startswith('plant.') for name in changed):
            return False
        if isinstance(law, HarmonicAttenuation):
            law.set_gain(_gain(values))
        return True


def _gain(values: Mapping[str, Any]) -> ModeGain:
    return ModeGain(
        values['plant.gain'],
        values['plant.natural_frequency'],
        values['plant.damping_ratio'],
        1.0 / values['rate'],
    )

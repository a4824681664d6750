"""The attenuation of harmonics that the parameters of its node describe."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import fields, replace
from typing import Any

from piezo_hysteresis.compensation.harmonics.harmonic_attenuation import (
    AttenuationSettings,
    HarmonicAttenuation,
)
from piezo_hysteresis.compensation.linear_gain import ModeGain
from piezo_hysteresis.models import ModelFile
from piezo_hysteresis.runtime.known_plant import GUESS, known_gain
from piezo_hysteresis.runtime.laws import Law

# The settings of the law are parameters under the same names.
_SETTINGS = tuple(field.name for field in fields(AttenuationSettings))
# Largest first step where nothing is known of the plant: beside a mode its gain may be 30 times
# the guess, and the error then grows by no more than it is.
UNKNOWN_PLANT = 0.05


class HarmonicLaws:
    """Makes attenuations of harmonics, see `LawMaker`."""

    def build(
        self, values: Mapping[str, Any], dt: float, model: ModelFile | None = None
    ) -> Law | None:
        """Return the law with the settings of `values`; None where it is not enabled."""
        given = {name: values[name] for name in _SETTINGS}
        given['orders'] = tuple(given['orders'])
        settings, gain = AttenuationSettings(**given), known_gain(values, dt, model)
        if gain is None:
            gain = ModeGain(GUESS, dt=dt)
            settings = replace(settings, first_step=min(settings.first_step, UNKNOWN_PLANT))
        law = HarmonicAttenuation(settings, gain, dt)
        return law if values['enabled'] else None

    def shapes(self, values: Mapping[str, Any], name: str) -> bool:
        """Return whether `name` is a setting of the law."""
        return name in _SETTINGS or name == 'enabled' or name.startswith('plant.')

    def adjust(
        self,
        law: Law | None,
        values: Mapping[str, Any],
        changed: Collection[str],
        model: ModelFile | None = None,
    ) -> bool:
        """Take a new model of the plant gain without forgetting the correction."""
        if not all(name.startswith('plant.') for name in changed):
            return False
        if isinstance(law, HarmonicAttenuation):
            gain = known_gain(values, 1.0 / values['rate'], model)
            law.set_gain(gain or ModeGain(GUESS, dt=1.0 / values['rate']))
        return True

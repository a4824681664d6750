"""Selection of the active inverse for the reference, and the transition to the next one."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field, replace

from piezo_hysteresis.compensation.controllers import Controllers
from piezo_hysteresis.compensation.inverses.inverse_link import HISTORY, InverseLink
from piezo_hysteresis.compensation.inverses.scheduled_inverse import ScheduledInverse
from piezo_hysteresis.compensation.link import ReferencePoint
from piezo_hysteresis.errors import PiezoError
from piezo_hysteresis.models import ModelFile


@dataclass
class Inversion:
    """The inverse of the loaded model, while models come and go."""

    settings: Controllers  # of the feedforward; its model is the one in force
    _inverse: InverseLink | ScheduledInverse | None = None
    _past: deque[ReferencePoint] = field(default_factory=lambda: deque(maxlen=HISTORY))

    @property
    def loaded(self) -> ModelFile | None:
        """The model in force."""
        return self.settings.model

    def take(self, loaded: ModelFile) -> bool:
        """Invert `loaded` from now on; return whether the output may jump by that.

        Parameters of the same chain go over smoothly by themselves.
        """
        before, jumps = self._inverse, False
        if loaded.schedule is not None and isinstance(before, ScheduledInverse):
            before.update(loaded)
        elif (
            loaded.schedule is None
            and _chain(loaded) == _chain(self.loaded)
            and isinstance(before, InverseLink)
        ):
            before.set_parameters(loaded.values)
        else:
            self._inverse, jumps = self._inverted(loaded), True
        self.settings = replace(self.settings, model=loaded)
        return jumps

    def change(self, settings: Controllers, *, rebuild: bool) -> None:
        """Take other settings over with the model in force; where rebuilt the output may jump."""
        self.settings = replace(settings, model=self.loaded)
        if rebuild and self.loaded is not None:
            self._inverse = self._inverted(self.loaded)

    def refusal(self, law: str, loaded: ModelFile | None = None) -> str:
        """Return '' or why a model, without one that in force, cannot be inverted by a law."""
        loaded = loaded or self.loaded
        if loaded is not None:
            try:
                replace(self.settings, law=law).inverse_of(loaded)
            except PiezoError as error:
                return str(error)
        return ''

    def voltage(self, point: ReferencePoint) -> float | None:
        """Return the voltage for this tick [V], None where there is no model."""
        self._past.append(point)
        return None if self._inverse is None else self._inverse.step(point, 0.0, None)

    def restart(self) -> None:
        """Start again from rest."""
        self._past.clear()
        if self._inverse is not None:
            self._inverse.reset()

    def counters(self) -> dict[str, int]:
        """Return what went wrong so far, by name."""
        return {} if self._inverse is None else self._inverse.counters()

    def _inverted(self, loaded: ModelFile) -> InverseLink | ScheduledInverse:
        inverse = self.settings.inverse_of(loaded)
        inverse.step(ReferencePoint(0, 0.0, 0.0, 0.0, 0.0, 0.0))  # compiled before the first tick
        inverse.reset()
        if self._past:
            inverse.follow(self._past)
        return inverse


def _chain(loaded: ModelFile | None) -> list[str]:
    return [] if loaded is None else [block.name for block in loaded.model.blocks]

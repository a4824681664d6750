"""Which inverse answers the reference, and how the next one takes over."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field

import numpy as np

from piezo_hysteresis.compensation.inverses.inverse_choice import inverse_for
from piezo_hysteresis.compensation.inverses.inverse_link import InverseLink
from piezo_hysteresis.compensation.link import Limits, ReferencePoint
from piezo_hysteresis.errors import PiezoError
from piezo_hysteresis.models import ModelFile

# Ticks of the reference that a new inverse is led through before it takes over, so that its
# hysteresis has the history of the one before.
HISTORY = 1000


@dataclass
class Inversion:
    """The inverse of the loaded model, while models come and go.

    Attributes
    ----------
    dt : float
        Sampling interval [s].
    limits : Limits
        Of the voltage.
    start, transition : float
        Times over which the reference is eased in and changes go over [s].
    law : str
        By which models are inverted, see `inverse_for`.
    """

    dt: float
    limits: Limits
    start: float
    transition: float
    law: str = 'auto'
    loaded: ModelFile | None = None
    _inverse: InverseLink | None = None
    _past: deque[ReferencePoint] = field(default_factory=lambda: deque(maxlen=HISTORY))

    def take(self, loaded: ModelFile) -> bool:
        """Invert `loaded` from now on; return whether the output may jump by that.

        Parameters of the same chain go over smoothly by themselves.

        Raises
        ------
        PiezoError
            If it cannot be inverted; the model before then stays in force.
        """
        if self._inverse is not None and _chain(loaded) == _chain(self.loaded):
            self._inverse.set_parameters(loaded.values)
            self.loaded = loaded
            return False
        self._inverse, self.loaded = self._inverted(loaded), loaded
        return True

    def rebuild(self, limits: Limits, transition: float, law: str = 'auto') -> None:
        """Take other settings over; the output may jump by that."""
        self.limits, self.transition, self.law = limits, transition, law
        if self.loaded is not None:
            self._inverse = self._inverted(self.loaded)

    def refusal(self, law: str, loaded: ModelFile | None = None) -> str:
        """Return '' or why a model, without one that in force, cannot be inverted by a law."""
        loaded = loaded or self.loaded
        if loaded is not None:
            try:
                inverse_for(loaded.model, loaded.values, self.dt, law=law)
            except PiezoError as error:
                return str(error)
        return ''

    def voltage(self, point: ReferencePoint) -> float | None:
        """Return the voltage for this tick [V], None where there is no model."""
        self._past.append(point)
        return None if self._inverse is None else self._inverse.step(point, 0.0, None)

    def forget(self) -> None:
        """Start again from rest."""
        self._past.clear()
        if self._inverse is not None:
            self._inverse.reset()

    def counters(self) -> dict[str, int]:
        """Return what went wrong so far, by name."""
        return {} if self._inverse is None else self._inverse.counters()

    def _inverted(self, loaded: ModelFile) -> InverseLink:
        inverse = inverse_for(
            loaded.model,
            loaded.values,
            self.dt,
            limits=self.limits,
            start=0.0 if self._past else self.start,
            transition=self.transition,
            law=self.law,
        )
        inverse.respond(np.zeros(3))  # compiles the kernel before the first tick
        for point in self._past:
            inverse.step(point, 0.0, None)
        return inverse


def _chain(loaded: ModelFile | None) -> list[str]:
    return [] if loaded is None else [block.name for block in loaded.model.blocks]

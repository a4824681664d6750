"""What a link that compares the measurement with the reference asks, and who makes it."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Any, Protocol

from piezo_hysteresis.compensation.link import Measured, ReferencePoint
from piezo_hysteresis.models import ModelFile


class Law(Protocol):
    """What such a link asks at every tick."""

    def step(self, point: ReferencePoint, received: float, measured: Measured | None) -> float:
        """Return the voltage to pass on [V]."""

    def reset(self) -> None:
        """Forget everything but the settings."""

    def counters(self) -> dict[str, int]:
        """Return what happened so far, by name."""


class LawMaker(Protocol):
    """Makes the law that the parameters of a node describe."""

    def build(
        self, values: Mapping[str, Any], dt: float, model: ModelFile | None = None
    ) -> Law | None:
        """Return the law of the parameters `values` at ticks of `dt` [s]; None for none.

        The plant is that of `plant.*` or, where ``plant.gain`` is 0, of the loaded `model`.

        Raises
        ------
        PiezoError
            If they describe none that is possible.
        """

    def shapes(self, values: Mapping[str, Any], name: str) -> bool:
        """Return whether the parameter `name` shapes the law of `values` at all."""

    def adjust(
        self,
        law: Law | None,
        values: Mapping[str, Any],
        changed: Collection[str],
        model: ModelFile | None = None,
    ) -> bool:
        """Change `law` to the `changed` of `values`; return False where it takes a new one."""

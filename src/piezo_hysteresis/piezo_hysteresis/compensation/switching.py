"""Several controllers in one place of the chain, one in charge; changed without a jump."""

from __future__ import annotations

from collections.abc import Mapping

from piezo_hysteresis.compensation.base import Limits, Link, Measured, ReferencePoint
from piezo_hysteresis.compensation.transition import Transition
from piezo_hysteresis.errors import CompensationError


class Switch:
    """A link that passes each tick to the one of its links that is in charge.

    On a change the new one starts from rest and the difference to what the old one gave fades
    along a smooth step, no faster than the slew limit.

    Parameters
    ----------
    links : mapping of str to Link
        The controllers by name.
    active : str
        Name of the one that starts; ``''`` for none, which passes on what it receives.
    dt : float
        Sampling interval [s].
    transition : float
        Seconds that a change takes [s].
    limits : Limits, optional
        Their slew bounds the pace of the change.

    Raises
    ------
    CompensationError
        If `active` is not one of the names.
    """

    def __init__(
        self,
        links: Mapping[str, Link],
        active: str,
        dt: float,
        *,
        transition: float = 0.2,
        limits: Limits | None = None,
    ) -> None:
        self._links = dict(links)
        slew = float('inf') if limits is None else limits.slew
        self._transition = Transition(dt, transition, slew)
        self._switches = 0
        self._check(active)
        self._active = active

    @property
    def active(self) -> str:
        """Name of the link in charge; ``''`` for none."""
        return self._active

    def select(self, active: str) -> None:
        """Put another link in charge, from the next tick on.

        Raises
        ------
        CompensationError
            If there is none of that name; the old one then stays in charge.
        """
        self._check(active)
        if active == self._active:
            return
        self._active = active
        self._switches += 1
        if active:
            self._links[active].reset()
        self._transition.start()

    def step(
        self, point: ReferencePoint, received: float, measured: Measured | None = None
    ) -> float:
        """Return what the link in charge passes on [V]."""
        link = self._links.get(self._active)
        wanted = received if link is None else link.step(point, received, measured)
        # Only the share of the links fades, never what came from the front of the chain.
        return received + self._transition.apply(wanted - received)

    def counters(self) -> dict[str, int]:
        """Return the changes so far and the counters of the link in charge."""
        link = self._links.get(self._active)
        own = {} if link is None else link.counters()
        return {'switches': self._switches, **own}

    def reset(self) -> None:
        """Reset every link; the one in charge stays."""
        for link in self._links.values():
            link.reset()
        self._transition.reset()
        self._switches = 0

    def _check(self, name: str) -> None:
        if name and name not in self._links:
            raise CompensationError(
                f'there is no controller {name!r}; choose one of {", ".join(self._links)}, or '
                "'' for none"
            )

"""Interface of a link of the voltage chain, independent of ROS and of the clock."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple, Protocol

# What `inverse_for` can be asked for: the best there is, a paper's own law (as in CITATION.cff),
# the exact inverse of one Bouc-Wen block, the numeric one of any chain, or a mere gain.
INVERSES = (
    'auto', 'fujii2018', 'tatebatake2017', 'zhou2021', 'xiao2014', 'fang2019', 'exact', 'numeric',
    'gain',
)  # fmt: skip


class ReferencePoint(NamedTuple):
    """The reference at one tick.

    Attributes
    ----------
    sample : int
        Number of the tick.
    displacement, velocity, acceleration : float
        Desired displacement [m] and its derivatives [m/s], [m/s^2].
    frequency : float
        Fundamental frequency [Hz]; 0 where there is none.
    phase : float
        Accumulated phase of the fundamental [rad].
    """

    sample: int
    displacement: float
    velocity: float
    acceleration: float
    frequency: float
    phase: float


class Measured(NamedTuple):
    """The newest measurement available to a link; in lock-step that of the previous tick.

    Attributes
    ----------
    sample : int
        Number of the tick it belongs to.
    voltage : float
        What was commanded at that tick [V].
    displacement : float
        What was measured at that tick, before that voltage acted [m].
    """

    sample: int
    voltage: float
    displacement: float


class Link(Protocol):
    """One link of the chain: adds its share to the voltage that it receives.

    A feedforward link is the first of the chain and receives 0.
    """

    def step(self, point: ReferencePoint, received: float, measured: Measured | None) -> float:
        """Return the voltage to pass on [V]."""

    def reset(self) -> None:
        """Reset the state; the parameters stay."""

    def counters(self) -> dict[str, int]:
        """Return the counters of faults, by name (clamped slopes, limited samples, ...)."""


@dataclass(frozen=True)
class Limits:
    """What no link ever exceeds.

    Attributes
    ----------
    low, high : float
        Range of the commanded voltage [V].
    slew : float
        Largest change [V/s].
    """

    low: float = -1.2
    high: float = 1.2
    slew: float = 1000.0

"""Interface between the page and its backend, which is ROS or a test."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar, Protocol

from piezo_hysteresis.dashboard.controls import Value
from piezo_hysteresis.dashboard.live_state import Live


class Answer:
    """The asynchronous response of a node."""

    def __init__(self) -> None:
        self.done = False
        self.reason = ''

    def give(self, reason: str = '') -> None:
        """Set the response."""
        self.reason = reason
        self.done = True


@dataclass(frozen=True)
class SweepOrder:
    """A sweep requested by the page."""

    kind: ClassVar[str] = 'sweep'
    frequencies: tuple[float, ...]  # [Hz]
    amplitudes: tuple[float, ...]  # [V]
    seconds: float  # durations of each record [s]
    warm_up: float  # [s]
    pause: float  # the pause after it [s]
    name: str  # bag of the records, below ``sweeps`` in the folder


@dataclass(frozen=True)
class DiscoveryOrder:
    """A discovery requested by the page."""

    kind: ClassVar[str] = 'discovery'
    data: tuple[str, ...]  # bags, as `Backend.bags` names them
    baseline: str  # named model


@dataclass(frozen=True)
class InvestigationOrder:
    """An investigation requested by the page."""

    kind: ClassVar[str] = 'investigation'
    low: float  # range of the voltage [V]; both 0 for the range of the actuator
    high: float
    slew: float  # largest rate of the voltage [V/s], 0 for no limit
    budget: float  # actuator time [s], 0 for the default
    name: str  # folder of journal and bags, below ``investigations`` in the folder


Order = SweepOrder | DiscoveryOrder | InvestigationOrder


class Backend(Protocol):
    """Interface to the nodes of any actuator; every call returns immediately."""

    def actuators(self) -> list[str]:
        """Return the existing namespaces, never an empty list."""

    def allows(self, actuator: str) -> bool:
        """Return whether a requested namespace may be shown."""

    def live(self, actuator: str) -> Live:
        """Return the state of an actuator, and subscribe to it if necessary."""

    def set_parameters(self, actuator: str, node: str, values: Mapping[str, Value]) -> Answer:
        """Set parameters of a node in sequence, until one is rejected."""

    def start(self, actuator: str, order: Order) -> None:
        """Start what is ordered; `Live` has its state under the kind of the order."""

    def cancel(self, actuator: str, kind: str) -> None:
        """Cancel a job by its kind; a driven actuator returns to rest."""

    def bags(self, actuator: str) -> list[str]:
        """Return the recorded bags, the newest first."""

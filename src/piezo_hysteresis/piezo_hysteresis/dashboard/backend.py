"""Interface between the page and its backend, which is ROS or a test."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol

from piezo_hysteresis.dashboard.controls import Value
from piezo_hysteresis.dashboard.live_state import Live


class Answer:
    """The asynchronous response of a node.

    Attributes
    ----------
    done : bool
        Whether it has been received.
    reason : str
        Reason of a rejection, '' if accepted.
    """

    def __init__(self) -> None:
        self.done = False
        self.reason = ''

    def give(self, reason: str = '') -> None:
        """Set the response."""
        self.reason = reason
        self.done = True


@dataclass(frozen=True)
class SweepOrder:
    """A sweep requested by the page.

    Attributes
    ----------
    frequencies, amplitudes : tuple of float
        Every frequency [Hz] at every amplitude [V].
    seconds, warm_up, pause : float
        Durations of each record, its warm-up and the pause after it [s].
    name : str
        Bag of the records, below ``sweeps`` in the folder.
    """

    frequencies: tuple[float, ...]
    amplitudes: tuple[float, ...]
    seconds: float
    warm_up: float
    pause: float
    name: str


@dataclass(frozen=True)
class DiscoveryOrder:
    """A discovery requested by the page.

    Attributes
    ----------
    data : tuple of str
        Bags, as `Backend.bags` names them.
    baseline : str
        Named model.
    """

    data: tuple[str, ...]
    baseline: str


@dataclass(frozen=True)
class InvestigationOrder:
    """An investigation requested by the page.

    Attributes
    ----------
    low, high : float
        Range of the voltage [V]; both 0 for the range of the actuator and the model.
    slew : float
        Largest rate of the voltage [V/s], 0 for no limit.
    budget : float
        Actuator time [s], 0 for the default.
    name : str
        Folder of journal and bags, below ``investigations`` in the folder.
    """

    low: float
    high: float
    slew: float
    budget: float
    name: str


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

    def start_sweep(self, actuator: str, order: SweepOrder) -> None:
        """Run a sweep and record it; `Live.sweep` has its state."""

    def cancel_sweep(self, actuator: str) -> None:
        """Cancel the sweep; the actuator returns to rest."""

    def start_discovery(self, actuator: str, order: DiscoveryOrder) -> None:
        """Run a discovery on recorded data; `Live.discovery` has its state."""

    def cancel_discovery(self, actuator: str) -> None:
        """Cancel the discovery."""

    def start_investigation(self, actuator: str, order: InvestigationOrder) -> None:
        """Run an investigation of the active model; `Live.investigation` has its state."""

    def cancel_investigation(self, actuator: str) -> None:
        """Cancel the investigation; the actuator returns to rest."""

    def bags(self, actuator: str) -> list[str]:
        """Return the recorded bags, the newest first."""

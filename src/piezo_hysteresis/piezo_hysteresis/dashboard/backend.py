"""What the page asks of its backend; ROS stands behind it, or a test."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol

from piezo_hysteresis.dashboard.controls import Value
from piezo_hysteresis.dashboard.live_state import Live


class Answer:
    """The answer of a node, which comes later.

    Attributes
    ----------
    done : bool
        Whether it has come.
    reason : str
        Why it was refused, '' where it was not.
    """

    def __init__(self) -> None:
        self.done = False
        self.reason = ''

    def give(self, reason: str = '') -> None:
        """Let it come."""
        self.reason = reason
        self.done = True


@dataclass(frozen=True)
class SweepOrder:
    """A sweep that the page asks for.

    Attributes
    ----------
    frequencies, amplitudes : tuple of float
        Every frequency [Hz] at every amplitude [V].
    seconds, warm_up, pause : float
        Of each record, and between them [s].
    name : str
        Bag that it is recorded into, below ``sweeps`` in the folder.
    """

    frequencies: tuple[float, ...]
    amplitudes: tuple[float, ...]
    seconds: float
    warm_up: float
    pause: float
    name: str


@dataclass(frozen=True)
class DiscoveryOrder:
    """A discovery that the page asks for.

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
    """An investigation that the page asks for.

    Attributes
    ----------
    low, high : float
        Range of the voltage [V]; twice 0 for what the actuator takes and the model knows.
    slew : float
        Fastest change of the voltage [V/s], 0 for no limit.
    budget : float
        Actuator time [s], 0 for the usual one.
    name : str
        Folder of journal and bags, below ``investigations`` in the folder.
    """

    low: float
    high: float
    slew: float
    budget: float
    name: str


class Backend(Protocol):
    """Speaks to the nodes of any actuator; every call returns at once."""

    def actuators(self) -> list[str]:
        """Return the namespaces there are, never an empty list."""

    def allows(self, actuator: str) -> bool:
        """Return whether a namespace that a reader asks for may be looked at."""

    def live(self, actuator: str) -> Live:
        """Return what is known of an actuator; what is not yet listened to is from now on."""

    def set_parameters(self, actuator: str, node: str, values: Mapping[str, Value]) -> Answer:
        """Set parameters of a node, one after another; the first refusal ends it."""

    def start_sweep(self, actuator: str, order: SweepOrder) -> None:
        """Run a sweep and record it; `Live.sweep` has its state."""

    def cancel_sweep(self, actuator: str) -> None:
        """Let the actuator return to rest."""

    def start_discovery(self, actuator: str, order: DiscoveryOrder) -> None:
        """Run a discovery on recorded data; `Live.discovery` has its state."""

    def cancel_discovery(self, actuator: str) -> None:
        """Give a discovery up."""

    def start_investigation(self, actuator: str, order: InvestigationOrder) -> None:
        """Run an investigation of the active model; `Live.investigation` has its state."""

    def cancel_investigation(self, actuator: str) -> None:
        """Give an investigation up; the actuator returns to rest."""

    def bags(self, actuator: str) -> list[str]:
        """Return the bags that were recorded, the newest first."""

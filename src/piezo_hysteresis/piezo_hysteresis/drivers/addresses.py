"""Controllers by their addresses: ``gcs://HOST``, ``gcs:///dev/ttyUSB0``, ``nv200:///dev/...``."""

from __future__ import annotations

import math
from collections.abc import Callable
from urllib.parse import parse_qs, urlsplit

from piezo_hysteresis.compensation.link import Limits
from piezo_hysteresis.drivers.controller import Controller
from piezo_hysteresis.drivers.gcs import GcsConnection, GcsController, gcs_controller
from piezo_hysteresis.drivers.nv200 import Nv200Connection, Nv200Controller, nv200_controller
from piezo_hysteresis.drivers.wires import BAUD, TIMEOUT, DriverError, SerialWire, TcpWire, Wire

#: How addresses look, for help and messages.
FORMS = 'gcs://HOST[:PORT], gcs:///dev/ttyUSB0 or nv200:///dev/ttyUSB0'
#: Help of the option.
TAKE_OVER = 'stop the wave or motion of another client instead of refusing to drive the axis'

_Opened = Callable[[Wire, Limits, str, bool], Controller]


def _gcs(wire: Wire, limits: Limits, axis: str, take_over: bool) -> Controller:
    return GcsController(GcsConnection(wire), limits, axis, take_over)


def _nv200(wire: Wire, limits: Limits, axis: str, take_over: bool) -> Controller:
    return Nv200Controller(Nv200Connection(wire), limits, axis, take_over)


#: Each kind with its usual TCP port.
KINDS: dict[str, tuple[_Opened, int]] = {
    'gcs': (_gcs, gcs_controller.PORT),
    'nv200': (_nv200, nv200_controller.PORT),
}


def open_controller(
    text: str,
    axis: str = '1',
    low: float | None = None,
    high: float | None = None,
    slew: float | None = None,
    timeout: float = TIMEOUT,
    take_over: bool = False,
) -> Controller:
    """Connect to a controller; nothing moves.

    Parameters
    ----------
    text : str
        Its address: ``gcs://HOST[:PORT]`` by TCP, ``gcs:///dev/ttyUSB0?baud=115200`` by a serial
        port; ``nv200`` instead of ``gcs`` for those of piezosystem jena.
    axis : str
        Axis of the controller.
    low, high : float, optional
        Voltage limits [V]; those of the controller apply if they are narrower.
    slew : float, optional
        Slew limit [V/s].
    timeout : float
        Timeout of a response [s].
    take_over : bool
        Whether the wave or motion of another client is stopped instead of refused.

    Raises
    ------
    DriverError
        If the address is invalid, or no such controller responds.
    """
    limits = Limits(
        -math.inf if low is None else low,
        math.inf if high is None else high,
        math.inf if slew is None else slew,
    )
    if not (limits.low <= 0.0 <= limits.high and limits.low < limits.high and limits.slew > 0.0):
        raise DriverError(
            f'{limits.low:g} .. {limits.high:g} V and {limits.slew:g} V/s allow nothing: a '
            'range holds 0 V, where waves begin and end, and a slew is above 0'
        )
    kind, wire = _wire(text, timeout)
    return KINDS[kind][0](wire, limits, axis, take_over)


def _wire(text: str, timeout: float) -> tuple[str, Wire]:
    """Return the kind of an address, and a connection to it."""
    wrong = DriverError(f'{text!r} is no controller: write {FORMS}')
    try:
        parts = urlsplit(text)
        host, port = parts.hostname, parts.port
        queries = parse_qs(parts.query, strict_parsing=True) if parts.query else {}
    except ValueError:
        raise wrong from None
    if parts.scheme not in KINDS or parts.fragment:
        raise wrong
    if host is not None:
        if queries or parts.path not in ('', '/'):
            raise wrong
        return parts.scheme, TcpWire(
            host, KINDS[parts.scheme][1] if port is None else port, timeout
        )
    bauds = queries.pop('baud', [str(BAUD)])
    if len(parts.path) < 2 or queries or len(bauds) != 1 or not bauds[0].isdigit():
        raise wrong
    return parts.scheme, SerialWire(parts.path, int(bauds[0]), timeout)

"""Messages that a separate listener receives from nodes that a page has started."""

from __future__ import annotations

import math
import time
import urllib.request
from collections import deque
from collections.abc import Callable, Iterator
from typing import Any

from expectations import COMPARISONS, QUANTITIES, Live
from rcl_interfaces.srv import ListParameters

from piezo_hysteresis.ros.client import Client
from piezo_hysteresis.ros.qos import LOOP
from piezo_interfaces.msg import ActuatorState, Reference, VoltageCommand

TIMEOUT = 400.0  # s until what is expected has to be heard, on a busy machine
STRETCH, STRETCHES = 2000, 3  # ticks that a tracking error is the rms of; the worst one counts


class TopicRecorder(Client):
    """A node that listens in a domain."""

    def __init__(self, domain: int, check: Callable[[], None]) -> None:
        super().__init__('reader', domain)
        self._check = check

    def until(self, condition: Callable[[], bool], seconds: float = TIMEOUT) -> bool:
        """Serve until `condition` holds or the time is over; say whether it does."""
        return self.wait(condition, seconds, self._check)


def tracking_rms(recorder: TopicRecorder) -> Iterator[float]:
    """Yield the rms of displacement minus reference, the worst of three stretches [m]."""
    wanted: dict[int, float] = {}
    squares: list[float] = []
    last: deque[float] = deque(maxlen=STRETCHES)

    def note(state: ActuatorState) -> None:
        desired = wanted.pop(state.sample, None)
        if desired is not None:
            squares.append((state.displacement - desired) ** 2)

    def desire(reference: Reference) -> None:
        wanted[reference.sample] = reference.displacement
        if len(wanted) > 10 * STRETCH:
            del wanted[next(iter(wanted))]

    recorder.node.create_subscription(Reference, 'reference', desire, LOOP)
    recorder.node.create_subscription(ActuatorState, 'actuator/state', note, LOOP)
    while recorder.until(lambda: len(squares) >= STRETCH):
        last.append(math.sqrt(sum(squares[:STRETCH]) / STRETCH))
        del squares[:STRETCH]
        if len(last) == STRETCHES:
            yield max(last)


def states(recorder: TopicRecorder) -> Iterator[float]:
    """Yield how many ticks of the actuator were heard [1]."""
    received: list[ActuatorState] = []
    recorder.node.create_subscription(ActuatorState, 'actuator/state', received.append, LOOP)
    while True:
        recorder.until(lambda: False, 0.5)
        yield float(len(received))


def not_numbers(recorder: TopicRecorder) -> Iterator[float]:
    """Yield how many voltages are no number while the commands are none [1]."""
    publisher = recorder.node.create_publisher(VoltageCommand, 'voltage/command', LOOP)
    received: list[bool] = []
    commanded = [0]

    def answer(state: ActuatorState) -> None:
        received.append(not math.isfinite(state.voltage))
        publisher.publish(VoltageCommand(sample=state.sample + 1, voltage=math.nan))
        commanded[0] += publisher.get_subscription_count()

    recorder.node.create_subscription(ActuatorState, 'actuator/state', answer, LOOP)
    if recorder.until(lambda: commanded[0] > 500 and len(received) > 500):
        yield float(sum(received))


MEASURES: dict[str, Callable[[TopicRecorder], Iterator[float]]] = {
    'tracking_rms': tracking_rms,
    'states': states,
    'not_numbers': not_numbers,
}
assert MEASURES.keys() == QUANTITIES.keys()


def listen(expected: Live, domain: int, check: Callable[[], None]) -> None:
    """Wait until what is expected is heard."""
    if expected.quantity == 'serves':
        _served(expected.value, check)
        return
    with TopicRecorder(domain, check) as recorder:
        if expected.quantity == 'answers':
            _answered(recorder, expected.value)
            return
        holds, bound = COMPARISONS[expected.comparison], float(expected.value)
        end = time.monotonic() + TIMEOUT
        received: list[float] = []
        for each in MEASURES[expected.quantity](recorder):
            received.append(each)
            if holds(each, bound):
                return
            if time.monotonic() > end:
                break
    shown = ', '.join(f'{each:.4g}' for each in received[-5:]) or 'nothing'
    raise AssertionError(f'{expected.quantity} was {shown}, not {expected.comparison} {bound:g}')


def _answered(recorder: TopicRecorder, name: str) -> None:
    client: Any = recorder.node.create_client(ListParameters, f'{name}/list_parameters')
    assert recorder.until(client.service_is_ready), f'{name} is not there'
    future = client.call_async(ListParameters.Request())
    assert recorder.until(future.done), f'{name} does not answer'
    assert future.result().result.names, f'{name} has no parameters'


def _served(url: str, check: Callable[[], None]) -> None:
    end = time.monotonic() + TIMEOUT
    while True:
        check()
        try:
            with urllib.request.urlopen(url, timeout=10) as answer:
                assert answer.status == 200, f'{url} answers {answer.status}'
                return
        except OSError as error:
            if time.monotonic() > end:
                raise AssertionError(f'{url}: {error}') from None
            time.sleep(0.5)

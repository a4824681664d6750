"""A listener in the test's own process, with a context and domain of its own."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, TypeVar

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rcl_interfaces.msg import ParameterValue, SetParametersResult
from rcl_interfaces.srv import GetParameters, SetParameters
from rclpy.parameter import Parameter, parameter_value_to_python

from piezo_hysteresis.ros.client import Client
from piezo_hysteresis.ros.processes import NodeProcesses
from piezo_hysteresis.ros.qos import LATCHED, LOOP
from piezo_interfaces.msg import ActuatorState, VoltageCommand

Message = TypeVar('Message')


class Listener(Client):
    """Collects messages and calls services of the nodes under test."""

    def __init__(self, processes: NodeProcesses) -> None:
        super().__init__('listener', processes.domain)
        self._processes = processes
        self._clients: dict[str, Any] = {}
        self.received: dict[str, list[Any]] = {}

    def listen(self, kind: type[Message], topic: str, *, latched: bool = False) -> list[Message]:
        """Collect every message of `topic` in the list that is returned, ``heard[topic]``."""
        book = self.received.setdefault(topic, [])
        self.node.create_subscription(kind, topic, book.append, LATCHED if latched else LOOP)
        return book

    @contextmanager
    def collecting(self, kind: type[Message], topic: str) -> Iterator[list[Message]]:
        """Collect messages of `topic` from now on; none of them was sent before."""
        received: list[Message] = []
        subscription = self.node.create_subscription(kind, topic, received.append, LOOP)
        yield received
        self.node.destroy_subscription(subscription)

    def watch_health(self) -> dict[str, DiagnosticStatus]:
        """Return what every node says of its health, by its whole name; kept up to date."""
        newest: dict[str, DiagnosticStatus] = {}

        def note(array: DiagnosticArray) -> None:
            newest.update({status.name.strip('/'): status for status in array.status})

        self.node.create_subscription(DiagnosticArray, '/diagnostics', note, 100)
        return newest

    def says(
        self, health: dict[str, DiagnosticStatus], node: str, level: bytes | None, word: str
    ) -> dict[str, str]:
        """Wait until `node` reports `level`, None for any, and `word`; return its values."""

        def said() -> bool:
            status = health.get(node)
            return status is not None and level in (None, status.level) and word in status.message

        self.until(said)
        return {each.key: each.value for each in health[node].values}

    def tells(self, health: dict[str, DiagnosticStatus], node: str, key: str, value: str) -> None:
        """Wait until `node` gives `value` for `key` beside its health, however that is."""

        def told() -> bool:
            status = health.get(node)
            return status is not None and value in [v.value for v in status.values if v.key == key]

        self.until(told)

    def until(self, condition: Callable[..., Any], timeout: float = 90.0) -> None:
        """Serve until `condition` holds."""
        came = self.wait(condition, timeout, self._processes.check)
        assert came, 'the awaited condition did not come true'

    def wait_briefly(self, condition: Callable[..., Any], seconds: float) -> None:
        """Serve until `condition` holds or the time is over."""
        self.wait(condition, seconds, self._processes.check)

    def serve(self, seconds: float) -> None:
        """Serve for a while; only where nothing is meant to happen."""
        end = time.monotonic() + seconds
        while (left := end - time.monotonic()) > 0:
            self.spin_once(left)

    def matched(self, topic: str, timeout: float = 90.0) -> None:
        """Serve until somebody publishes `topic`."""
        self.until(lambda: self.node.count_publishers(topic) > 0, timeout)

    def call(self, kind: type, service: str, request: Any, timeout: float = 90.0) -> Any:
        """Call a service and return its response."""
        client = self._clients.get(service)
        if client is None:
            client = self._clients[service] = self.node.create_client(kind, service)
            self.found_by(service.rpartition('/')[0], timeout)
        self.until(client.service_is_ready, timeout)
        future = client.call_async(request)
        self.until(future.done, timeout)
        return future.result()

    def found_by(self, node: str, timeout: float = 90.0) -> None:
        """Wait until `node` has found all clients that were made so far.

        The middleware drops an answer if it has not found within 0.1 s who asked; on a busy
        machine that happens. Clients are found in the order in which they are made, so that an
        answer to one that is made here is enough; it is asked for until it comes.
        """
        client = self.node.create_client(GetParameters, f'{node}/get_parameters')
        self.until(client.service_is_ready, timeout)
        answers: list[Any] = []
        again = 0.0

        def answered() -> bool:
            nonlocal again
            if time.monotonic() > again:
                again = time.monotonic() + 1.0
                answers.append(client.call_async(GetParameters.Request()))
            return any(answer.done() for answer in answers)

        self.until(answered, timeout)
        self.node.destroy_client(client)

    def set_parameters(self, node: str, values: dict[str, Any]) -> list[SetParametersResult]:
        """Set parameters over the node's service, as ``ros2 param set`` does; return results."""
        parameters = [Parameter(name, value=value) for name, value in values.items()]
        request = SetParameters.Request(parameters=[p.to_parameter_msg() for p in parameters])
        return list(self.call(SetParameters, f'{node}/set_parameters', request).results)

    def set_one(self, node: str, name: str, value: Any) -> str:
        """Set one parameter; return '' or the reason why it was refused."""
        (result,) = self.set_parameters(node, {name: value})
        assert result.successful or result.reason, 'refused without a reason'
        return '' if result.successful else str(result.reason)

    def get_parameter(self, node: str, name: str) -> Any:
        """Return the value of a parameter, None where there is none."""
        request = GetParameters.Request(names=[name])
        values: list[ParameterValue] = self.call(
            GetParameters, f'{node}/get_parameters', request
        ).values
        return parameter_value_to_python(values[0]) if values else None


class Driver:
    """Takes the place of the whole chain: commands a lock-step simulator tick by tick."""

    def __init__(self, listener: Listener) -> None:
        self._listener = listener
        self.states = listener.listen(ActuatorState, 'actuator/state')
        self._publisher = listener.node.create_publisher(VoltageCommand, 'voltage/command', LOOP)
        listener.matched('actuator/state')
        listener.until(lambda: self._publisher.get_subscription_count() > 0)
        self.tick = 0

    def send(self, sample: int, voltage: float) -> None:
        """Publish one command."""
        self._publisher.publish(VoltageCommand(sample=sample, voltage=voltage))

    def step(self, voltage: float) -> ActuatorState:
        """Command `voltage` for the next tick and return its state."""
        count = len(self.states)
        self.send(self.tick, voltage)
        self._listener.until(lambda: len(self.states) > count)
        state = self.states[-1]
        assert state.sample == self.tick
        self.tick += 1
        return state

"""Calls services and actions of running nodes, for the verb ``call``."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import yaml
from rclpy.action import ActionClient, get_action_names_and_types

from piezo_hysteresis.common import plain_yaml
from piezo_hysteresis.common.wording import near, reason_of
from piezo_hysteresis.errors import PiezoError
from piezo_hysteresis.nodes.recording.listeners import message_type
from piezo_hysteresis.ros.client import Client

Report = Callable[[str], None]

# Fast DDS finds the nodes of a domain within this time [s].
_FOUND = 4.0
# Period of the printed feedback of an action [s].
_FEEDBACK = 1.0
# Packages of the services that every node has.
_OF_RCL = ('rcl_interfaces/', 'type_description_interfaces/')


class Caller(Client):
    """Client node, alive within a `with` block."""

    def __init__(self, timeout: float) -> None:  # timeout [s]
        super().__init__('_call')
        self._timeout = timeout

    def names(self) -> dict[str, str]:
        """Return the types of all services and actions in the domain, without those of rcl."""
        self.wait(lambda: False, min(_FOUND, self._timeout))
        known = sorted(self._known().items())
        return {name: kind for name, kind in known if not kind.startswith(_OF_RCL)}

    def call(self, name: str, text: str, report: Report) -> tuple[list[str], bool]:
        """Call a service or an action; return its response as YAML and whether it succeeded."""
        if not self.wait(lambda: name in self._known(), self._timeout):
            known = self._known()
            raise PiezoError(
                f'there is no service or action {name}{near(name, known)}; see `call`'
            )
        kind = self._known()[name]
        found: Any = message_type(kind)
        is_action = '/action/' in kind
        request = filled(found.Goal() if is_action else found.Request(), _mapping(text), name)
        if is_action:
            answer = self._act(found, name, request, report)
        else:
            answer = self._ask(found, name, request)
        return lines_of(answer), bool(getattr(answer, 'success', True))

    def _known(self) -> dict[str, str]:
        actions = get_action_names_and_types(self.node)
        services = self.node.get_service_names_and_types()
        return {
            name: types[0]
            for name, types in (*services, *actions)
            if '/_action/' not in name and types
        }

    def _ask(self, service: Any, name: str, request: Any) -> Any:
        client = self.node.create_client(service, name)
        if not self.wait(client.service_is_ready, self._timeout):
            raise PiezoError(f'{name} did not answer within {self._timeout:g} s')
        return self._awaited(client.call_async(request), name, self._timeout)

    def _act(self, action: Any, name: str, goal: Any, report: Report) -> Any:
        client = ActionClient(self.node, action, name)
        due = 0.0

        def on_feedback(message: Any) -> None:
            nonlocal due
            if time.monotonic() >= due:
                due = time.monotonic() + _FEEDBACK
                report(', '.join(lines_of(message.feedback)))

        if not self.wait(client.server_is_ready, self._timeout):
            raise PiezoError(f'{name} did not answer within {self._timeout:g} s')
        handle = self._awaited(client.send_goal_async(goal, on_feedback), name, self._timeout)
        if not handle.accepted:
            raise PiezoError(f'{name} refuses the goal; the log of its node has the reason')
        ended = handle.get_result_async()
        try:
            self.wait(ended.done, check=lambda: self._require(client, name))
        except KeyboardInterrupt:
            handle.cancel_goal_async()
            self.wait(ended.done, self._timeout)
            raise
        return ended.result().result

    def _require(self, client: Any, name: str) -> None:
        if not client.server_is_ready():
            raise PiezoError(f'the node of {name} has ended')

    def _awaited(self, future: Any, name: str, seconds: float) -> Any:
        if not self.wait(future.done, seconds):
            raise PiezoError(f'{name} did not answer within {seconds:g} s')
        return future.result()


def filled(message: Any, values: Mapping[str, Any], where: str) -> Any:
    """Set the fields of a message, and of those inside, and return it."""
    fields = message.get_fields_and_field_types()
    for name, value in values.items():
        if name not in fields:
            its = ', '.join(fields) or 'none'
            raise PiezoError(f'{where} has no field {name}{near(name, fields)}; its fields: {its}')
        present = getattr(message, name)
        try:
            if hasattr(present, 'get_fields_and_field_types'):
                if not isinstance(value, Mapping):
                    raise TypeError
                filled(present, value, f'{where}.{name}')
            else:
                setattr(message, name, _typed(value, fields[name]))
        except (AssertionError, TypeError, ValueError, OverflowError):
            raise PiezoError(f'{where}: {name} is {fields[name]}, not {value!r}') from None
    return message


def _typed(value: Any, kind: str) -> Any:
    """Return a value as floats where the field holds floats; ROS takes nothing else."""
    if kind.startswith('sequence<') and not isinstance(value, list):
        raise TypeError
    if not kind.startswith(('double', 'float', 'sequence<double', 'sequence<float')):
        return value
    found = value if isinstance(value, list) else [value]
    if any(isinstance(each, bool | str) for each in found):
        raise TypeError
    floats = [float(each) for each in found]
    return floats if isinstance(value, list) else floats[0]


def lines_of(message: Any) -> list[str]:
    """Return the fields of a message as YAML, one a line."""
    return yaml.safe_dump(_plain(message), sort_keys=False, width=1000).splitlines()


def _plain(value: Any) -> Any:
    if hasattr(value, 'get_fields_and_field_types'):
        return {each: _plain(getattr(value, each)) for each in value.get_fields_and_field_types()}
    if isinstance(value, str | bool | int | float):
        return value
    return [_plain(each) for each in value] if isinstance(value, Sequence) else value.tolist()


def _mapping(text: str) -> dict[str, Any]:
    try:
        found = plain_yaml.load(text) if text.strip() else {}
    except yaml.YAMLError as error:
        raise PiezoError(f'the request is no YAML: {reason_of(error)}') from None
    if not isinstance(found, dict):
        raise PiezoError("write the fields as YAML, such as '{frequencies: [1, 5], seconds: 2.0}'")
    return found

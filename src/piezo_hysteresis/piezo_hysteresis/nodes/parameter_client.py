"""Clients of running nodes for the verbs ``param`` and ``call``."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import yaml
from rcl_interfaces.msg import ParameterValue
from rcl_interfaces.srv import GetParameters, ListParameters, SetParameters
from rclpy.action import ActionClient, get_action_names_and_types
from rclpy.parameter import Parameter, parameter_value_to_python
from rclpy.parameter_client import AsyncParameterClient

from piezo_hysteresis.common import plain_yaml
from piezo_hysteresis.common.wording import counted, near, reason_of
from piezo_hysteresis.errors import PiezoError
from piezo_hysteresis.nodes.recording.listeners import message_type
from piezo_hysteresis.ros.client import Client

# Time without a new node after which discovery is complete [s].
QUIET = 0.5
# Time in which Fast DDS finds the first node [s].
ALONE = 4.0
# Fast DDS drops a response if it does not find the client within 0.1 s, as on a busy machine [s].
AGAIN = 1.0


class ParameterClient(Client):
    """Client node, alive within a `with` block."""

    def __init__(self, timeout: float) -> None:  # timeout [s]
        super().__init__('_param')
        self._timeout = timeout

    def listed(self, node: str = '') -> list[str]:
        """Return the nodes, or parameters of one with their values."""
        if not node:
            return self._nodes() or ['no node is running in this domain']
        client, names = self._client(node), self._names(node)
        values = self._values(node, client, names)
        return [
            f'{name}: {_shown(parameter_value_to_python(value))}'
            for name, value in zip(names, values, strict=True)
        ]

    def value(self, node: str, name: str) -> list[str]:
        """Return the value of a parameter."""
        values = self._values(node, self._client(node), [name])
        if not values or parameter_value_to_python(values[0]) is None:
            raise PiezoError(
                f'{node} has no parameter {name}{near(name, self._names(node))}; '
                f'`param list {node}` tells them'
            )
        return [_shown(parameter_value_to_python(values[0]))]

    def change(self, node: str, name: str, text: str) -> list[str]:
        """Set a parameter to a value in YAML."""
        self._set(node, {name: _meant(text)})
        return [f'{node} {name} is {text}']

    def load(self, node: str, file: str) -> list[str]:
        """Set the parameters of a node from a file."""
        try:
            content = plain_yaml.load_file(file)
        except (OSError, yaml.YAMLError) as error:
            raise PiezoError(f'{file} cannot be read: {reason_of(error)}') from None
        short = node.rpartition('/')[2]
        found: dict[str, Any] = {}
        for key, part in content.items() if isinstance(content, dict) else ():
            if key in ('/**', node) or str(key).rpartition('/')[2] == short:
                inner = part.get('ros__parameters', {}) if isinstance(part, dict) else {}
                found |= _flat(inner)
        if not found:
            raise PiezoError(f'{file} holds no parameters of {node}')
        self._set(node, found)
        return [f'{node}: {counted(len(found), "parameter")} set']

    def _set(self, node: str, values: dict[str, Any]) -> None:
        parameters = [_parameter(name, value) for name, value in values.items()]
        client = self._client(node)
        answer: SetParameters.Response = self._answer(
            lambda: client.set_parameters(parameters), node
        )
        for name, result in zip(values, answer.results, strict=True):
            if not result.successful:
                known = self._names(node)
                if name not in known:
                    raise PiezoError(f'{node} has no parameter {name}{near(name, known)}')
                raise PiezoError(f'{node} refuses {name}: {result.reason or "no reason given"}')

    def _values(
        self, node: str, client: AsyncParameterClient, names: list[str]
    ) -> Sequence[ParameterValue]:
        answer: GetParameters.Response = self._answer(lambda: client.get_parameters(names), node)
        return answer.values

    def _names(self, node: str) -> list[str]:
        client = self._client(node)
        answer: ListParameters.Response = self._answer(client.list_parameters, node)
        return sorted(answer.result.names)

    def _nodes(self) -> list[str]:
        names: list[str] = []
        changed = time.monotonic()
        while time.monotonic() - changed < (QUIET if names else ALONE):
            self.spin_once()
            found = self.node.get_node_names_and_namespaces()
            seen = sorted(f'{s.rstrip("/")}/{n}' for n, s in found if not n.startswith('_'))
            if seen != names:
                names, changed = seen, time.monotonic()
        return names

    def _client(self, node: str) -> AsyncParameterClient:
        client = AsyncParameterClient(self.node, node)
        if not self.wait(client.services_are_ready, self._timeout):
            known = self._nodes()
            running = f'running nodes: {", ".join(known)}' if known else 'no node is running'
            raise PiezoError(f'there is no node {node}{near(node, known)}; {running}')
        return client

    def _answer(self, ask: Callable[[], Any], node: str) -> Any:
        """Return the response to a request; the request is idempotent and is repeated."""
        end = time.monotonic() + self._timeout
        asked: list[Any] = []
        while (left := end - time.monotonic()) > 0.0:
            asked.append(ask())
            self.wait(lambda: any(map(_answered, asked)), min(AGAIN, left))
            for future in filter(_answered, asked):
                return future.result()
        raise PiezoError(f'{node} did not answer within {self._timeout:g} s')


def _answered(future: Any) -> bool:
    return future.done() and future.result() is not None


def _meant(text: str) -> Any:
    """Return the value of an entered text; a mapping remains text."""
    try:
        value = plain_yaml.load(text)
    except yaml.YAMLError:
        return text
    plain = isinstance(value, bool | int | float | str | list)
    return value if plain else text


def _parameter(name: str, value: Any) -> Parameter:
    if isinstance(value, list) and not value:
        return Parameter(name, Parameter.Type.BOOL_ARRAY, [])
    if isinstance(value, list) and {type(each) for each in value} == {int, float}:
        value = [float(each) for each in value]
    try:
        return Parameter(name, value=value)
    except (TypeError, ValueError):
        raise PiezoError(f'{name}: {value!r} is no value of a parameter') from None


def _flat(values: Any, prefix: str = '') -> dict[str, Any]:
    found: dict[str, Any] = {}
    for key, value in values.items() if isinstance(values, dict) else ():
        if isinstance(value, dict):
            found |= _flat(value, f'{prefix}{key}.')
        else:
            found[f'{prefix}{key}'] = value
    return found


def _shown(value: Any) -> str:
    """Return a value as YAML on one line."""
    if value is not None and not isinstance(value, bool | int | float | str):
        value = list(value)
    text = yaml.safe_dump(value, default_flow_style=True, width=1000).strip()
    return text.removesuffix('...').strip()


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

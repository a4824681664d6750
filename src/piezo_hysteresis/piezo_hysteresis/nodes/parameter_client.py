"""Reads and sets the parameters of running nodes, for the verb ``param``."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from typing import Any

import yaml
from rcl_interfaces.msg import ParameterValue
from rcl_interfaces.srv import GetParameters, ListParameters, SetParameters
from rclpy.parameter import Parameter, parameter_value_to_python
from rclpy.parameter_client import AsyncParameterClient

from piezo_hysteresis.common import plain_yaml
from piezo_hysteresis.common.wording import counted, near, reason_of
from piezo_hysteresis.errors import PiezoError
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

"""Requests of an investigation to other nodes."""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import partial
from typing import Any

from rcl_interfaces.srv import GetParameters, SetParameters
from rclpy.parameter import Parameter, parameter_value_to_python
from rclpy.parameter_client import AsyncParameterClient

from piezo_hysteresis.errors import PiezoError
from piezo_hysteresis.models import ModelFile
from piezo_hysteresis.ros.client import Client
from piezo_interfaces.srv import LoadModel

# Timeout of an answer and of the discovery of a node, which may have just been started on a slow
# machine [s].
TIMEOUT = 30.0
# Time until a request is repeated: a node cannot answer a client that it has not found yet [s].
ASK_AGAIN = 5.0
# Timeout for the use of a model, which may compile kernels [s].
COMPILED_WITHIN = 120.0
EXCITATION = 'excitation'
# Nodes that use a model, in the order of the requests.
USERS = ('feedforward', 'attenuation', 'feedback', 'gap_monitor')


class Cancelled(PiezoError):
    """The client has cancelled the work."""


class Unanswered(PiezoError):
    """A node is missing or does not respond; it may be restarted."""


class CancellableClient(Client):
    """Client node whose waits end when it is cancelled."""

    def __init__(self, name: str, namespace: str) -> None:
        super().__init__(name, namespace=namespace)
        self.cancelled = False

    def check(self) -> None:
        """Raise if the work was cancelled."""
        if self.cancelled:
            raise Cancelled('cancelled; the actuator is at rest and the journal is kept')

    def waited(self, condition: Callable[[], object], timeout: float = TIMEOUT) -> bool:
        """Wait until a condition holds; return whether it does."""
        return self.wait(condition, timeout, self.check)


class Neighbourhood:
    """The excitation and the nodes that use a model."""

    def __init__(self, client: CancellableClient) -> None:
        self._client, node = client, client.node
        self._excitation = AsyncParameterClient(node, EXCITATION)
        self._users = {name: node.create_client(LoadModel, f'{name}/load_model') for name in USERS}

    def excitation(self, name: str) -> Any:
        """Return a parameter of the excitation."""
        self._there()
        answer: GetParameters.Response = self._answer(
            lambda: self._excitation.get_parameters([name])
        )
        return parameter_value_to_python(answer.values[0])

    def set_excitation(self, **values: str | float) -> None:
        """Set parameters of the excitation."""
        self._there()
        parameters = [Parameter(name, value=value) for name, value in values.items()]
        answer: SetParameters.Response = self._answer(
            lambda: self._excitation.set_parameters(parameters)
        )
        for (name, value), result in zip(values.items(), answer.results, strict=True):
            if not result.successful:
                raise PiezoError(f'the excitation refuses {name} {value}: {result.reason}')

    def use(self, model: ModelFile) -> str:
        """Load a model into every running node; return the names of these nodes."""
        used = []
        for name, client in self._users.items():
            if not client.service_is_ready():
                continue
            ask = partial(client.call_async, LoadModel.Request(yaml=model.text()))
            answer: LoadModel.Response = self._answer(ask, COMPILED_WITHIN)
            if not answer.success:
                raise PiezoError(f'{name} does not take the model: {answer.message}')
            used.append(name)
        return ', '.join(used)

    def _there(self) -> None:
        if not self._client.waited(self._excitation.services_are_ready):
            raise Unanswered('no excitation is running: start it, and investigate again')

    def _answer(self, ask: Callable[[], Any], again: float = ASK_AGAIN) -> Any:
        end = time.monotonic() + TIMEOUT
        while time.monotonic() < end:
            future = ask()
            if self._client.waited(future.done, again) and future.result() is not None:
                return future.result()
        raise Unanswered('a node did not answer: see that it runs, and investigate again')

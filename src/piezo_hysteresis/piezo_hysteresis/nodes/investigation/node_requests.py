"""Requests of an investigation to other nodes, from a separate thread."""

from __future__ import annotations

import time
from collections.abc import Callable
from concurrent.futures import Future
from functools import partial
from typing import Any, TypeVar

from rcl_interfaces.srv import GetParameters, SetParameters
from rclpy.node import Node
from rclpy.parameter import Parameter, parameter_value_to_python
from rclpy.parameter_client import AsyncParameterClient

from piezo_hysteresis.errors import PiezoError
from piezo_hysteresis.models import ModelFile
from piezo_interfaces.srv import LoadModel

T = TypeVar('T')

LOOK = 0.02
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


def in_thread_of(node: Node, work: Callable[[], T]) -> T:
    """Run a function in the thread that spins a node; return its result to the calling thread.

    An action client of rclpy registers a request after sending it. If it is sent from another
    thread on a busy machine, the response can arrive before the registration and is lost.
    """
    result: Future[T] = Future()

    def task() -> None:
        try:
            result.set_result(work())
        except Exception as error:  # passed to the waiting thread
            result.set_exception(error)

    node.executor.create_task(task)
    return result.result()


def waited(
    condition: Callable[[], bool], stopped: Callable[[], bool], timeout: float = TIMEOUT
) -> bool:
    """Wait until a condition holds; return whether it does."""
    end = time.monotonic() + timeout
    while not condition():
        if stopped():
            raise Cancelled('cancelled; the actuator is at rest and the journal is kept')
        if time.monotonic() > end:
            return False
        time.sleep(LOOK)
    return True


class Neighbourhood:
    """The excitation and the nodes that use a model."""

    def __init__(self, node: Node) -> None:
        self._excitation = AsyncParameterClient(node, EXCITATION)
        self._users = {name: node.create_client(LoadModel, f'{name}/load_model') for name in USERS}

    def excitation(self, name: str, stopped: Callable[[], bool]) -> Any:
        """Return a parameter of the excitation."""
        self._there(stopped)
        answer: GetParameters.Response = self._answer(
            lambda: self._excitation.get_parameters([name]), stopped
        )
        return parameter_value_to_python(answer.values[0])

    def set_excitation(
        self, stopped: Callable[[], bool] = lambda: False, **values: str | float
    ) -> None:
        """Set parameters of the excitation."""
        self._there(stopped)
        parameters = [Parameter(name, value=value) for name, value in values.items()]
        answer: SetParameters.Response = self._answer(
            lambda: self._excitation.set_parameters(parameters), stopped
        )
        for (name, value), result in zip(values.items(), answer.results, strict=True):
            if not result.successful:
                raise PiezoError(f'the excitation refuses {name} {value}: {result.reason}')

    def use(self, model: ModelFile, stopped: Callable[[], bool]) -> str:
        """Load a model into every running node; return the names of these nodes."""
        used = []
        for name, client in self._users.items():
            if not client.service_is_ready():
                continue
            ask = partial(client.call_async, LoadModel.Request(yaml=model.text()))
            answer: LoadModel.Response = self._answer(ask, stopped, COMPILED_WITHIN)
            if not answer.success:
                raise PiezoError(f'{name} does not take the model: {answer.message}')
            used.append(name)
        return ', '.join(used)

    def _there(self, stopped: Callable[[], bool]) -> None:
        if not waited(self._excitation.services_are_ready, stopped):
            raise Unanswered('no excitation is running: start it, and investigate again')

    def _answer(
        self, ask: Callable[[], Any], stopped: Callable[[], bool], again: float = ASK_AGAIN
    ) -> Any:
        end = time.monotonic() + TIMEOUT
        while time.monotonic() < end:
            future = ask()
            if waited(future.done, stopped, again) and future.result() is not None:
                return future.result()
        raise Unanswered('a node did not answer: see that it runs, and investigate again')

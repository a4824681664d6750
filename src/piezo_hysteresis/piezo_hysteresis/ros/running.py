"""Starts, spins and stops a node."""

from __future__ import annotations

import ctypes
import ctypes.util
import gc
import os
import signal
import sys
import time
from collections.abc import Callable, Sequence
from importlib.resources import files
from pathlib import Path
from types import TracebackType

import rclpy
from rclpy.clock import Clock, ClockType
from rclpy.context import Context
from rclpy.duration import Duration
from rclpy.executors import Executor, ExternalShutdownException, SingleThreadedExecutor
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.signals import SignalHandlerOptions
from rclpy.task import Future
from rclpy.timer import Timer

from piezo_hysteresis.common.wording import near
from piezo_hysteresis.errors import PiezoError
from piezo_hysteresis.ros.starting import refuse_start

# Names the file of profiles that Fast DDS reads when the first node of a process is created.
PROFILES = 'FASTRTPS_DEFAULT_PROFILES_FILE'


def profiles(name: str = '') -> str:
    """Return the path of profiles that come with this package, for the Fast DDS at hand."""
    chosen = name or ('fastdds3.xml' if _has_fast_dds_3() else 'fastdds.xml')
    return str(files('piezo_hysteresis.ros') / chosen)


def _has_fast_dds_3() -> bool:
    """Return whether the sourced ROS 2 has Fast DDS 3, from Kilted on: its library was renamed."""
    places = os.environ.get('AMENT_PREFIX_PATH', '').split(os.pathsep)
    libraries = ('lib/libfastdds.so*', 'lib/*-linux-gnu/libfastdds.so*')
    return any(any(Path(each).glob(name)) for each in places if each for name in libraries)


def prepare() -> None:
    """Configure discovery of this process within a fraction of a second; call before `init`.

    By default Fast DDS announces a process every three seconds, and sends heartbeats at the same
    rate. A profile file of the user has priority; other middleware ignores the setting.
    """
    os.environ.setdefault(PROFILES, profiles())


def joined(domain: int | None = None) -> Context:
    """Return a separate context in a domain, in addition to that of the process."""
    prepare()
    context = Context()
    rclpy.init(args=[], context=context, domain_id=domain)
    return context


_SIGEV_THREAD = 2
_WHOLE_SIGEVENT = 64


class _Event(ctypes.Structure):
    """``struct sigevent`` of Linux, for a function in a separate thread."""

    _fields_ = (
        ('value', ctypes.c_void_p),
        ('signal', ctypes.c_int),
        ('notify', ctypes.c_int),
        ('function', ctypes.c_void_p),
        ('attributes', ctypes.c_void_p),
        ('rest', ctypes.c_byte * (_WHOLE_SIGEVENT - 32)),
    )


class _Times(ctypes.Structure):
    """``struct itimerspec``: interval and first time, each in seconds and nanoseconds."""

    _fields_ = tuple((name, ctypes.c_long) for name in ('every', 'every_ns', 'first', 'first_ns'))


class EndsWithin:
    """Ends the process with an exit code unless the ``with`` block is left before.

    A timer of the C library calls ``_exit``, because what hangs may hold the lock of Python.
    """

    def __init__(self, seconds: float, code: int) -> None:  # seconds [s]
        self._library = ctypes.CDLL(ctypes.util.find_library('c'), use_errno=True)
        self._timer = ctypes.c_void_p()
        end = ctypes.cast(self._library._exit, ctypes.c_void_p)
        self._event = _Event(value=code, notify=_SIGEV_THREAD, function=end)
        self._times = _Times(first=int(seconds), first_ns=int(seconds % 1.0 * 1e9))
        self._set = False

    def __enter__(self) -> None:
        clock = ctypes.c_int(time.CLOCK_MONOTONIC)
        made = self._library.timer_create(
            clock, ctypes.byref(self._event), ctypes.byref(self._timer)
        )
        self._set = made == 0
        if self._set:
            self._library.timer_settime(self._timer, 0, ctypes.byref(self._times), None)

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if self._set:
            self._library.timer_delete(self._timer)


def wall_timer(node: Node, period: float, callback: Callable[[], None]) -> Timer:
    """Call `callback` every `period` seconds of real time, regardless of ``use_sim_time``."""
    return node.create_timer(period, callback, clock=Clock(clock_type=ClockType.STEADY_TIME))


# How long a signal may wait to be seen [s].
LOOK = 0.1

# EventsExecutor never wakes from an endless wait on some builds; a finite one always does. A
# process whose wake-up is lost ends that late. Every wait costs 32 bytes that it never gives back:
# half a megabyte a day [s].
LONGEST_WAIT = 5.0

# Fast DDS 2.14 can block indefinitely if another node ends during its own shutdown: about one in a
# thousand if many nodes end together. By then all data are written and published [s].
LONGEST_END = 5.0

# How long an ending process waits for subscribers that have not yet received its messages [s]:
# a recorder that was not scheduled for a while would lose the last ones.
LONGEST_DELIVERY = 5.0

RCLError = rclpy_implementation.RCLError

EXECUTORS = ('auto', 'events', 'default')


def make_executor(choice: str, context: Context | None = None) -> Executor:
    """Return the executor for `choice`: the events executor if it works, else the default."""
    if choice not in EXECUTORS:
        raise ValueError(f'executor must be one of {", ".join(EXECUTORS)}, got {choice!r}')
    if choice != 'default':
        executor = _working_events_executor(context)
        if executor is not None:
            return executor
        if choice == 'events':
            raise ValueError('the events executor of this rclpy does not tick; use executor:=auto')
    return SingleThreadedExecutor(context=context)


def _working_events_executor(context: Context | None) -> Executor | None:
    try:
        from rclpy.experimental import EventsExecutor
    except ImportError:
        return None
    executor: Executor = EventsExecutor(context=context)
    return executor if _ticks(executor, context) else None


def _ticks(executor: Executor, context: Context | None) -> bool:
    """Return whether `executor` runs a timer at all (a self-test at start, some milliseconds)."""
    # Without the arguments of the process: they would give the probe the name of the node.
    probe = Node(
        'executor_probe',
        context=context,
        enable_rosout=False,
        start_parameter_services=False,
        use_global_arguments=False,
        parameter_overrides=[Parameter('start_type_description_service', value=False)],
    )
    ticked = Future()
    timer = probe.create_timer(0.001, lambda: ticked.done() or ticked.set_result(True))
    executor.add_node(probe)
    executor.spin_until_future_complete(ticked, timeout_sec=0.5)
    executor.remove_node(probe)
    timer.cancel()
    probe.destroy_node()
    return bool(ticked.done())


class Interrupt:
    """Stores the signals that end a process, without interrupting a callback.

    The handlers of rclpy shut down immediately, so that a running callback could not publish its
    result.
    """

    def __init__(self) -> None:
        self.requested = False
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, self._note)

    def _note(self, *_: object) -> None:
        self.requested = True

    @staticmethod
    def ignore() -> None:
        """Ignore further signals, because the process is ending.

        During shutdown Python would be killed by them, with a wrong exit code; `ros2 launch` sends
        several.
        """
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, signal.SIG_IGN)


def spin(
    nodes: Sequence[Node],
    executor: Executor,
    stop: Future | None = None,
    interrupt: Interrupt | None = None,
) -> None:
    """Serve `nodes` by `executor` until they are shut down, interrupted or `stop` is done."""
    for node in nodes:
        executor.add_node(node)
    ended = Future()

    def due() -> bool:
        done = stop is not None and stop.done()
        return done or (interrupt is not None and interrupt.requested)

    def look() -> None:
        if due() and not ended.done():
            ended.set_result(True)

    timer = wall_timer(nodes[0], LOOK, look)
    try:
        while nodes[0].context.ok() and not due():
            executor.spin_until_future_complete(ended, timeout_sec=LONGEST_WAIT)
    finally:
        timer.cancel()
        for node in nodes:
            executor.remove_node(node)
        executor.shutdown()


def run_node(create: Callable[[], Node], arguments: Sequence[str] | None = None) -> int:
    """Run one node as a process: start, spin, and stop without a traceback on any signal.

    A node may have ``stop`` (a Future that ends it), ``exit_code`` and ``close()`` (called before
    it is destroyed).

    Returns
    -------
    int
        Exit code of the process.
    """
    return run_nodes(lambda: (create(),), arguments)


def run_nodes(create: Callable[[], Sequence[Node]], arguments: Sequence[str] | None = None) -> int:
    """Run several nodes as one process with one executor; the first one decides when it ends."""
    interrupt = Interrupt()
    nodes: Sequence[Node] = ()
    try:
        _init(list(sys.argv if arguments is None else [sys.argv[0], *arguments]))
        nodes = _create(create)
        _name_mistyped(nodes)
        # Imported objects are permanent: exclude them from garbage collection.
        gc.collect()
        gc.freeze()
        choice = os.environ.get('PIEZO_EXECUTOR', 'auto')
        spin(nodes, make_executor(choice), getattr(nodes[0], 'stop', None), interrupt)
    except ExternalShutdownException:
        pass
    except SystemExit as wanted:
        return int(wanted.code or 0)
    finally:
        _close(nodes)
        interrupt.ignore()
    return exit_code(nodes)


def _init(options: list[str]) -> None:
    prepare()
    try:
        rclpy.init(args=options, signal_handler_options=SignalHandlerOptions.NO)
    except Exception as error:  # rclpy does not export the class of this error
        refuse_start(error)


def _create(create: Callable[[], Sequence[Node]]) -> Sequence[Node]:
    try:
        return create()
    except PiezoError as error:
        refuse_start(error)
    except RCLError as error:
        refuse_start(error, 'mend the names, or the ROS_SECURITY settings where they are set')


def _name_mistyped(nodes: Sequence[Node]) -> None:
    """Warn of values that no node of this process has a parameter for, but one nearly has."""
    known = {name for node in nodes for name in node._parameters}
    given = {name for node in nodes for name in node._parameter_overrides}
    for name in sorted(given - known):
        # those of a model come with it
        if not name.startswith('model.') and (guess := near(name, known)):
            log = nodes[0].get_logger()
            log.warning(f'there is no parameter {name}{guess}; its value is ignored')


def finish(nodes: Sequence[Node]) -> None:
    """Let nodes finish their tasks before they are destroyed."""
    for node in nodes:
        close = getattr(node, 'close', None)
        if close is not None:
            close()


def _close(nodes: Sequence[Node]) -> None:
    finish(nodes)
    sys.stdout.flush()
    _deliver(nodes)
    with EndsWithin(LONGEST_END, exit_code(nodes)):
        for node in nodes:
            destroy(node)
        rclpy.try_shutdown()


def _deliver(nodes: Sequence[Node]) -> None:
    """Wait until the subscribers have received all published messages."""
    end = time.monotonic() + LONGEST_DELIVERY
    for publisher in [each for node in nodes for each in node.publishers]:
        publisher.wait_for_all_acked(Duration(seconds=max(0.0, end - time.monotonic())))


def exit_code(nodes: Sequence[Node]) -> int:
    """Return the exit code that the first node requests."""
    return int(getattr(nodes[0], 'exit_code', 0)) if nodes else 0


def destroy(node: Node) -> None:
    """Destroy a node with its actions, which `destroy_node` leaves.

    A remaining action keeps the participant of the middleware alive. It then ends during process
    exit, concurrently with its own threads: some crash, some block indefinitely.
    """
    for waitable in tuple(node.waitables):
        end = getattr(waitable, 'destroy', None)
        if end is not None:
            end()
    node.destroy_node()

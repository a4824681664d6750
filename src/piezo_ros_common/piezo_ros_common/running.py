"""Starts, spins and stops a node: one helper for all of them."""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Callable, Sequence

import rclpy
from rclpy.executors import Executor, ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.task import Future

# EventsExecutor never wakes from an endless wait on some builds; a finite one always does.
LONGEST_WAIT = 1.0

EXECUTORS = ('auto', 'events', 'default')


def make_executor(choice: str) -> Executor:
    """Return the executor for `choice`: the events executor where it works, else the default.

    Raises
    ------
    ValueError
        If `choice` is not one of `EXECUTORS`.
    """
    if choice not in EXECUTORS:
        raise ValueError(f'executor must be one of {", ".join(EXECUTORS)}, got {choice!r}')
    if choice != 'default':
        executor = _working_events_executor()
        if executor is not None:
            return executor
        if choice == 'events':
            raise ValueError('the events executor of this rclpy does not tick; use executor:=auto')
    return SingleThreadedExecutor()


def _working_events_executor() -> Executor | None:
    try:
        from rclpy.experimental import EventsExecutor
    except ImportError:
        return None
    executor: Executor = EventsExecutor()
    return executor if _ticks(executor) else None


def _ticks(executor: Executor) -> bool:
    """Tell whether `executor` runs a timer at all (a self-test at start, some milliseconds)."""
    # Without the arguments of the process: they would give the probe the name of the node.
    probe = Node(
        'executor_probe',
        enable_rosout=False,
        start_parameter_services=False,
        use_global_arguments=False,
    )
    ticked = Future()
    timer = probe.create_timer(0.001, lambda: ticked.done() or ticked.set_result(True))
    executor.add_node(probe)
    executor.spin_until_future_complete(ticked, timeout_sec=0.5)
    executor.remove_node(probe)
    timer.cancel()
    probe.destroy_node()
    return bool(ticked.done())


def spin(node: Node, choice: str = 'auto', stop: Future | None = None) -> None:
    """Serve `node` until it is shut down or `stop` is done."""
    executor = make_executor(choice)
    executor.add_node(node)
    stop = Future() if stop is None else stop
    try:
        while rclpy.ok() and not stop.done():
            executor.spin_until_future_complete(stop, timeout_sec=LONGEST_WAIT)
    finally:
        executor.remove_node(node)
        executor.shutdown()


def run_node(create: Callable[[], Node], arguments: Sequence[str] | None = None) -> int:
    """Run one node as a process: start, spin, and stop without a traceback on any signal.

    A node may have ``stop`` (a Future that ends it), ``exit_code`` and ``close()`` (called before
    it is destroyed, when nothing can be published any more).

    Returns
    -------
    int
        Exit code of the process.
    """
    node: Node | None = None
    try:
        _init(list(sys.argv if arguments is None else [sys.argv[0], *arguments]))
        node = create()
        choice = os.environ.get('PIEZO_EXECUTOR', 'auto')
        spin(node, choice, getattr(node, 'stop', None))
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    except SystemExit as wanted:
        return int(wanted.code or 0)
    except Exception:
        if rclpy.ok():  # else something was under way when the signal came
            raise
    finally:
        _close(node)
    return int(getattr(node, 'exit_code', 0))


def _init(words: list[str]) -> None:
    try:
        rclpy.init(args=words)
    except Exception as error:  # rclpy does not export the class of this error
        reason = ' '.join(str(error).split())
        print(f'error: {reason} (mend the arguments or the parameter file)', file=sys.stderr)
        raise SystemExit(2) from None


def _close(node: Node | None) -> None:
    # A second Ctrl-C while closing must not cut the closing short.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    if node is not None:
        close = getattr(node, 'close', None)
        if close is not None:
            close()
        node.destroy_node()
    rclpy.try_shutdown()

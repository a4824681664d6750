"""The simulator's own clock: ticks without gaps, every late or missing command counted."""

from __future__ import annotations

import signal
from itertools import pairwise

import numpy as np
import pytest
from builtin_interfaces.msg import Time
from listening import Listener
from rclpy.action import ActionClient
from rclpy.publisher import Publisher
from rosgraph_msgs.msg import Clock

from piezo_hysteresis.ros.processes import NodeProcesses
from piezo_hysteresis.ros.qos import LOOP
from piezo_hysteresis.runtime.sweep_plan import Sweep
from piezo_interfaces.action import RunSweep
from piezo_interfaces.msg import ActuatorState, LoopStatus, VoltageCommand

pytestmark = pytest.mark.ros

RATE = 250.0
TIMEOUT = 0.6
RAMP = 20.0
SAFE = 0.5
SLEW = 80.0
SETTINGS = {
    'clock': 'real_time',
    'rate': RATE,
    'speed_factor': 0.5,  # eight milliseconds to answer a state in, on a busy machine
    'command_timeout': TIMEOUT,
    'ramp': RAMP,
    'safe_voltage': SAFE,
    'publish_clock': True,
}


def nanoseconds(stamp: Time) -> int:
    return stamp.sec * 10**9 + stamp.nanosec


def answer(
    listener: Listener, states: list[ActuatorState], publisher: Publisher, count: int
) -> int:
    """Command -1 V for the tick behind every state; return the last tick that was commanded."""
    first = done = len(states)
    while done < first + count:
        listener.until(lambda seen=done: len(states) > seen)
        for state in states[done:]:
            publisher.publish(VoltageCommand(sample=state.sample + 1, voltage=-1.0))
        done = len(states)
    return states[done - 1].sample + 1


def test_real_time(processes: NodeProcesses, listener: Listener) -> None:
    states = listener.listen(ActuatorState, 'actuator/state')
    clock = listener.listen(Clock, '/clock')
    status = listener.listen(LoopStatus, 'loop/status', latched=True)
    publisher = listener.node.create_publisher(VoltageCommand, 'voltage/command', LOOP)
    processes.start('piezo_sim', 'simulator', SETTINGS)
    listener.until(lambda: states and status and publisher.get_subscription_count())

    # Answer every state, as an excitation does; what comes too late is counted, not lost.
    last = answer(listener, states, publisher, 200)
    while states[-1].voltage != -1.0:
        last = answer(listener, states, publisher, 20)
    publisher.publish(VoltageCommand(sample=0, voltage=-3.0))  # doubled: long over
    publisher.publish(VoltageCommand(sample=last + 10**9, voltage=-3.0))  # of another run

    # Silence: the voltage is held for the timeout, then goes to safety at the ramp.
    listener.until(lambda: states[-1].voltage == SAFE)
    # Where the last command was late, safety had been on its way and was taken back.
    newest = max(k for k, state in enumerate(states) if state.voltage == -1.0)
    held = states[newest:]
    steps = [b.voltage - a.voltage for a, b in pairwise(held)]
    assert min(state.voltage for state in states) == -1.0
    assert max(steps) <= RAMP / RATE * (1 + 1e-9)
    assert min(steps) >= 0.0
    moves = next(state.sample for state in held if state.voltage > -1.0)
    first = max((k for k, s in enumerate(states[:newest]) if s.voltage != -1.0), default=-1) + 1
    assert moves - states[first].sample >= TIMEOUT * RATE - 1

    behind = states[-1].sample - 20
    assert behind > last
    publisher.publish(VoltageCommand(sample=behind, voltage=0.25))
    listener.until(lambda: states[-1].voltage == 0.25)
    taken = states[-1].sample
    listener.until(lambda: status and status[-1].sample > taken)
    known = dict(zip(status[-1].names, status[-1].counts, strict=True))
    assert status[-1].late >= 1
    assert status[-1].doubled == 1
    assert status[-1].refused == 1
    assert known['timeouts'] >= 1
    # One missed tick at least for each that the voltage was held, none once it is taken for over.
    begin = max((s for s in status if s.sample <= last), key=lambda s: s.sample)
    missed = status[-1].missed - begin.missed
    assert TIMEOUT * RATE - 2 <= missed < status[-1].sample - begin.sample

    # Another pace, while it runs: no tick is left out, and time goes by the number of the tick.
    assert listener.set_one('simulator', 'speed_factor', 1) == ''
    count = len(states)
    listener.until(lambda: len(states) > count + 50)
    samples = [state.sample for state in states]
    assert samples == sorted(set(samples))
    # Of all states a listener on a busy machine may miss some; about the change it has them all.
    near = samples[count - 25 : count + 50]
    assert near == list(range(near[0], near[0] + 75))
    stamps = [nanoseconds(state.header.stamp) for state in states]
    assert stamps == [round(sample * 1e9 / RATE) for sample in samples]
    times = [nanoseconds(each.clock) for each in clock]
    assert len(set(times) & set(stamps)) > 200
    assert times == sorted(set(times))


def test_an_excitation_that_comes_late_moves_nothing_faster_than_its_slew(
    processes: NodeProcesses, listener: Listener
) -> None:
    health = listener.watch_health()
    settings = {'clock': 'real_time', 'rate': RATE, 'command_timeout': 10.0}
    processes.start('piezo_sim', 'simulator', settings)
    node = processes.start('piezo_hysteresis', 'excitation', {'rate': RATE, 'slew': SLEW})
    client = ActionClient(listener.node, RunSweep, 'run_sweep')
    listener.until(client.server_is_ready)
    listener.found_by('excitation')
    # Only now: states of a slow start would still be queued when the sweep has ended.
    states = listener.listen(ActuatorState, 'actuator/state')
    listener.until(lambda: states)
    goal = RunSweep.Goal(frequencies=[5.0, 10.0], amplitudes=[1.0], seconds=2.0)
    plan = Sweep(goal.frequencies, goal.amplitudes, goal.seconds, RATE)
    future = client.send_goal_async(goal)
    listener.until(future.done)
    ended = future.result().get_result_async()
    stops = 0
    while not ended.done():
        listener.serve(0.2)
        node.signal(signal.SIGSTOP)  # for far longer than a tick
        listener.serve(0.07)
        node.signal(signal.SIGCONT)
        stops += 1
    assert ended.result().result.success, ended.result().result.message
    assert stops > 5

    listener.until(lambda: len(states) > plan.length and states[-1].voltage == 0.0)
    sample = np.array([state.sample for state in states], dtype=np.int64)
    voltage = np.array([state.voltage for state in states])
    planned = np.abs(np.diff([plan.voltage(k) for k in range(plan.length)])).max()
    assert planned < SLEW / RATE  # only what comes late is held back
    follows = np.diff(sample) == 1
    assert np.abs(voltage).max() > 0.5
    assert np.abs(np.diff(voltage))[follows].max() <= SLEW / RATE * (1.0 + 1e-6)
    listener.says(health, 'excitation', None, 'held back to slew')

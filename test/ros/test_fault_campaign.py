"""A short part of `bench/faults.py`: every node dies once, messages go wrong, nothing jumps."""

from __future__ import annotations

import signal
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from listening import Listener
from live_nodes import LiveNodes

from piezo_hysteresis.records.bag_content import read_content
from piezo_hysteresis.records.damage import DamageLog
from piezo_hysteresis.records.definitions import STATE
from piezo_hysteresis.ros.qos import LOOP
from piezo_interfaces.msg import ActuatorState, LoopStatus

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from bench.faults import Campaign, Trial
from bench.faults_watch import Watch, missing
from bench.live_loop import NODES, Loop, Setting, wait_until
from bench.live_observer import Observer, State
from bench.rogue import Rogue
from piezo_hysteresis.common import topics

pytestmark = pytest.mark.ros

SEED = 20


@pytest.fixture(scope='module')
def campaign(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Campaign]:
    with LiveNodes() as nodes:
        yield from campaign_of(nodes, tmp_path_factory.mktemp('campaign'))


@pytest.fixture
def deadly(processes: LiveNodes, tmp_path: Path) -> Iterator[Campaign]:
    """Return a campaign whose nodes can be killed."""
    yield from campaign_of(processes, tmp_path)


def campaign_of(nodes: LiveNodes, folder: Path) -> Iterator[Campaign]:
    observer = Observer(nodes)
    loop = Loop(nodes, folder, Setting())
    watch = Watch(observer.seen, loop.setting)
    random = np.random.default_rng(SEED)
    running = Campaign(loop, observer, Rogue(observer), watch, random)
    running.begin()
    yield running
    observer.close()


def as_it_should_be(trial: Trial) -> bool:
    return trial.faults == []


@pytest.mark.parametrize('fault', ['nan', 'huge', 'from_zero'])
def test_a_rogue_moves_nothing_it_must_not(campaign: Campaign, fault: str) -> None:
    trial = campaign.run(topics.VOLTAGE_COMMAND, fault)
    assert as_it_should_be(trial), trial


def test_the_sensor_fails_and_comes_back(campaign: Campaign) -> None:
    trial = campaign.run('simulator', 'sensor_dropout')
    assert as_it_should_be(trial), trial


@pytest.mark.slow
def test_every_node_is_killed_once_and_the_loop_is_back(deadly: Campaign) -> None:
    """All at random moments, each while the one before is not yet up again; the recorder last."""
    loop, watch = deadly.loop, deadly.watch
    first = watch.mark()
    for name in deadly.random.permutation([n for n in NODES if n != 'recorder']):
        number = signal.SIGKILL if deadly.random.random() < 0.5 else signal.SIGTERM
        code, text = loop.end(str(name), number)
        assert code == (0 if number == signal.SIGTERM else -number)
        assert 'Traceback' not in text
        node = loop.start(str(name))
        assert node.returncode is None
    since = deadly.observer.seen.states[-1].arrived
    back, received = watch.back(since, 'feedback', 90.0)
    assert back is not None
    assert received is not None
    beyond, jump, _ = watch.voltage(first)
    assert beyond == 0.0
    assert jump <= 1.0 + 1e-9
    states = deadly.observer.seen.states
    assert wait_until(lambda: states[-1].life == 1, 30.0), 'the actuator was not started anew'
    asked = states[-1].arrived
    code, text = loop.end('recorder', signal.SIGTERM)
    assert code == 0, text
    assert watch.lost(loop.bags[-1], asked, killed=False) == (0, 0.0)


def test_a_recorder_that_is_ended_keeps_all_that_has_reached_it(
    processes: LiveNodes, listener: Listener, tmp_path: Path
) -> None:
    """What came while it was not scheduled waits in the middleware; a signal must not lose it."""
    publisher = listener.node.create_publisher(ActuatorState, topics.STATE, LOOP)
    bag = tmp_path / 'bag'
    recorder = processes.start('piezo_hysteresis', 'recorder', {'out': str(bag)})
    status = listener.listen(LoopStatus, 'recorder/status', latched=True)
    listener.until(lambda: publisher.get_subscription_count() > 0, 60.0)
    publisher.publish(ActuatorState(sample=0))
    listener.until(lambda: status and status[-1].sample > 0)
    recorder.signal(signal.SIGSTOP)
    for k in range(1, 500):
        publisher.publish(ActuatorState(sample=k))
    recorder.signal(signal.SIGTERM)
    recorder.signal(signal.SIGCONT)
    assert recorder.wait(60.0) == 0
    (held,) = read_content(bag, DamageLog(False)).of_type(STATE)
    assert held.column('sample').tolist() == list(range(500))


def states_of(samples: list[int]) -> list[State]:
    return [State(0.1 * k, 0, k, 0.01 * k, 1e-6 * k) for k in samples]


def test_lost_samples_are_counted_separately_from_those_of_a_kill() -> None:
    seen = states_of(list(range(20)))
    keys = [(s.sample, s.voltage, s.displacement) for s in seen]
    assert missing(keys[3:], seen, killed=False) == (0, 0.0)
    assert missing([*keys[3:8], *keys[10:]], seen, killed=False) == (2, 0.0)
    lost, unflushed = missing([*keys[3:8], *keys[10:15]], seen, killed=True)
    assert lost == 2
    assert unflushed == pytest.approx(0.4)
    assert missing(keys[3:15], seen, killed=False)[0] == 5
    again = [state._replace(life=1) for state in states_of(list(range(30, 40)))]
    later = [(s.sample, s.voltage, s.displacement) for s in again]
    assert missing([*keys, *later[4:]], [*seen, *again], killed=False) == (0, 0.0)
    assert missing([*keys, later[4], *later[7:]], [*seen, *again], killed=False) == (2, 0.0)
    assert missing(keys, [*seen, *again], killed=False) == (10, 0.0)
    # the actuator may have been killed while it told one of its last tick, and not the other
    assert missing([*keys[:-1], *later], [*seen, *again], killed=False) == (0, 0.0)
    assert missing([*keys[:-2], *later], [*seen, *again], killed=False) == (1, 0.0)

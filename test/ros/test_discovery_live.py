"""What discovery found is loaded into running nodes, and the gap is seen to close there too."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from listening import Listener
from live_nodes import LiveNodes

from piezo_hysteresis.discovery import discover
from piezo_hysteresis.models import ModelFile, named
from piezo_hysteresis.reporting.discovery_report import write_discovery
from piezo_interfaces.msg import ActuatorState, Gap, Reference
from piezo_sim.sweep import simulate

pytestmark = pytest.mark.ros

HIDDEN = {'effects.resonance': True}
WINDOW = 0.5
RATE = 1000.0


@pytest.fixture(scope='module')
def found(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Discover the hidden effect offline; return the folder of the results."""
    plan = [
        {'kind': 'sine', 'frequency': f, 'amplitude': a, 'duration': 4.0}
        for a, frequencies in ((1.0, (1, 7, 14, 23, 40)), (0.5, (1, 23)))
        for f in frequencies
    ]
    records = simulate('generic_bouc_wen', plan, HIDDEN, 5)
    discovery = discover(records, named('classical'), workers=2)
    out = tmp_path_factory.mktemp('found')
    write_discovery(out, discovery)
    base = discovery.baselines.joint
    own = {name: base.values[name] for name in base.model.parameter_names}
    baseline = ModelFile(base.model, own)
    parameters = baseline.to_ros_parameters() | {'model.noise_floor': discovery.floor}
    (out / 'baseline_params.yaml').write_text(
        yaml.safe_dump({'/**': {'ros__parameters': parameters}}, sort_keys=False)
    )
    assert [effect.name for effect in discovery.verdict.effects] == ['resonance']
    return out


def loaded(path: Path) -> dict[str, Any]:
    content = yaml.safe_load(path.read_text())
    return dict(content['/**']['ros__parameters'])


def test_the_gap_closes_in_running_nodes(
    processes: LiveNodes, listener: Listener, found: Path
) -> None:
    listener.listen(Gap, 'gap')
    processes.start(
        'piezo_sim',
        'simulator',
        {'clock': 'lock_step', 'preset': 'generic_bouc_wen', 'wait_for': 3},
    )
    processes.start('piezo_hysteresis', 'feedforward', {'start': 0.2})
    processes.start('piezo_hysteresis', 'attenuation', {'enabled': False})
    processes.start('piezo_hysteresis', 'gap_monitor', {'window': WINDOW})
    assert load(listener, 'gap_monitor', found / 'params.yaml')
    assert load(listener, 'feedforward', found / 'params.yaml')
    listener.matched('actuator/state')
    processes.start(
        'piezo_hysteresis',
        'excitation',
        {'mode': 'reference', 'frequency': 23.0, 'reference.amplitude': 8e-5, 'wait_for': 2},
    )
    # The simulator lacks the effect: the model that has it is far away.
    without = settled_gap(listener)
    assert without.floors > 20.0
    assert without.beyond_floor
    assert without.family

    # The effect goes into the running simulator: the gap falls to the floor.
    assert all(one.successful for one in listener.set_parameters('simulator', HIDDEN))
    assert settled_gap(listener, seconds=3.0).floors < 1.5
    good = tracking_error(listener)

    # The baseline alone is far away and compensates badly; what was found mends both.
    assert load(listener, 'gap_monitor', found / 'baseline_params.yaml')
    assert load(listener, 'feedforward', found / 'baseline_params.yaml')
    assert settled_gap(listener, seconds=2.0).floors > 20.0
    poor = tracking_error(listener)
    assert poor > 5.0 * good
    assert load(listener, 'gap_monitor', found / 'params.yaml')
    assert load(listener, 'feedforward', found / 'params.yaml')
    assert settled_gap(listener, seconds=3.0).floors < 1.5
    assert tracking_error(listener) < 0.3 * poor


def load(listener: Listener, node: str, path: Path) -> bool:
    """Set the parameters of a file one by one, as ``ros2 param load`` does."""
    results = listener.set_parameters(node, loaded(path))
    refused = [result.reason for result in results if not result.successful]
    assert not refused, refused
    return True


def settled_gap(listener: Listener, seconds: float = 2.0) -> Gap:
    """Return the newest gap after `seconds` of simulated time.

    The loop runs as fast as it can: a listener that heard all of it would fall behind.
    """
    gaps = listener.received['gap']
    with listener.collecting(ActuatorState, 'actuator/state') as states:
        listener.until(lambda: states)
    end = states[0].sample + round(seconds * RATE)
    listener.until(lambda: gaps and gaps[-1].sample >= end, timeout=120.0)
    gap: Gap = gaps[-1]
    return gap


def tracking_error(listener: Listener) -> float:
    """Return the rms of measured minus desired over half a second [m]."""
    half = round(0.5 * RATE)
    with (
        listener.collecting(ActuatorState, 'actuator/state') as states,
        listener.collecting(Reference, 'reference') as references,
    ):
        for received in (states, references):
            listener.until(lambda h=received: h and h[-1].sample >= h[0].sample + half)
    desired = {r.sample: r.displacement for r in references}
    errors = [s.displacement - desired[s.sample] for s in states if s.sample in desired]
    assert len(errors) >= 100
    return float(np.sqrt(np.mean(np.square(errors))))

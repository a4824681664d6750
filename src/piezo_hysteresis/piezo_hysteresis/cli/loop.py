"""Run the loop in one terminal: simulated actuator, voltage chain, monitors, live page.

Actuator, `control_loop`, and each node that watches are separate processes. Ctrl-C stops all.
"""

from __future__ import annotations

import argparse
import math
import os
import signal
import time
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from piezo_hysteresis.cli.shared_options import ros_needed
from piezo_hysteresis.common.registry import inside, package_of
from piezo_hysteresis.common.wording import counted
from piezo_hysteresis.compensation.inverses.reach import usual_reference
from piezo_hysteresis.compensation.limiter import require_limits
from piezo_hysteresis.compensation.link import Limits
from piezo_hysteresis.compensation.operating_limits import rate_of
from piezo_hysteresis.errors import PiezoError
from piezo_hysteresis.models.modelfile import ModelFile, is_modal

if TYPE_CHECKING:
    from piezo_hysteresis.ros.processes import NodeProcesses

EXAMPLE = 'loop --model out/model/model.yaml'
ONE_AXIS = 'fdk_pzba_00030'


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of this verb."""
    add = parser.add_argument
    add('--model', metavar='YAML', help='model file of identify (default: no compensation)')
    add('--preset', help=f'preset of the simulated actuator (default: {ONE_AXIS}, for one axis)')
    add(
        '--frequency',
        type=float,
        default=23.0,
        metavar='HZ',
        help='frequency of the reference [Hz]',
    )
    add(
        '--amplitude',
        type=float,
        metavar='UM',
        help='amplitude of the reference [µm] (default: half of what the model reaches, or 120)',
    )
    add(
        '--clock',
        choices=('lock_step', 'real_time'),
        default='lock_step',
        help='clock of the simulator',
    )
    add(
        '--limits',
        nargs=3,
        type=float,
        metavar=('LOW', 'HIGH', 'SLEW'),
        help='limits of the voltage [V] and of its slew [V/s] for a model of several axes',
    )
    add('--port', type=int, default=5006, help='port of the live page')
    add('--folder', default='~/piezo_hysteresis', help='folder for sweeps and discoveries')
    add('--seconds', type=float, metavar='S', help='run time [s] (default: until Ctrl-C)')


def run(arguments: argparse.Namespace) -> int:
    """Start every node and wait for their end."""
    _require_numbers(arguments)
    model = _checked(arguments.model)
    of = nodes_of_axes if is_modal(model) else _of_one_axis
    started = of(arguments, model)
    with ros_needed():
        from piezo_hysteresis.ros import processes
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: processes.INTERRUPTED.set())
    end = time.monotonic() + (arguments.seconds or float('inf'))
    domain = int(os.environ.get('ROS_DOMAIN_ID') or 0)
    try:
        with processes.NodeProcesses(domain) as group:
            for name, settings in started.items():
                group.start(package_of(name), name, settings)
            _print_addresses(group, arguments, model)
            while time.monotonic() < end:
                group.check()
                time.sleep(0.1)
    except processes.ProcessError as error:
        raise PiezoError(str(error)) from None
    except KeyboardInterrupt:
        print('ended')
    return 0


def _require_numbers(arguments: argparse.Namespace) -> None:
    """Refuse what no node can run with, before one starts."""
    for name, unit in (('frequency', 'Hz'), ('amplitude', 'µm'), ('seconds', 's')):
        value = getattr(arguments, name)
        if value is not None and not (math.isfinite(value) and value > 0.0):
            raise PiezoError(f'--{name} must be a number above 0 {unit}, got {value:g}')


def _checked(model: str | None) -> str:
    if model is None:
        return ''
    if Path(model).is_dir():
        raise PiezoError(f'{model} is a folder; give the model.yaml in it')
    if not Path(model).is_file():
        raise PiezoError(f'{model} is not there: `identify` writes a model.yaml')
    return str(Path(model).resolve())


def _of_one_axis(arguments: argparse.Namespace, model: str) -> dict[str, dict[str, object]]:
    """Return the parameters of every node of a loop of one axis."""
    loaded = ModelFile.load(model) if model else None
    if arguments.limits is not None:
        raise PiezoError('--limits is for a model of several axes; this loop takes its own')
    rate, reference = rate_of(loaded), _reference(loaded, arguments.amplitude)
    return nodes(arguments, model, rate, reference)


def nodes_of_axes(arguments: argparse.Namespace, model: str) -> dict[str, dict[str, object]]:
    """Return the parameters of every node of a loop of several axes."""
    from piezo_hysteresis.axes import modal_file
    from piezo_hysteresis.compensation.coupled.decoupling import transfers

    if arguments.limits is None or arguments.preset is None:
        raise PiezoError(
            'a model of several axes names no stage and states no limits; give --preset and '
            '--limits LOW HIGH SLEW'
        )
    loaded = modal_file.load(model)
    low, high, slew = arguments.limits
    require_limits(Limits(low, high, slew))
    if not low <= 0.0 <= high:
        raise PiezoError(f'the loop rests at 0 V, which is outside {low:g} .. {high:g} V')
    still = abs(transfers(loaded, np.zeros(1, complex))[0][0].real.diagonal())
    reach = min(high, -low) * float(still.min())
    amplitude = 0.5 * reach if arguments.amplitude is None else 1e-6 * arguments.amplitude
    if amplitude > reach:
        raise PiezoError(
            f'within {low:g} .. {high:g} V the axes reach {1e6 * reach:.3g} µm about their rest; '
            f'give a smaller amplitude than {1e6 * amplitude:g} µm'
        )
    rate = 1.0 / loaded.dt
    excited = {
        # one frequency each, so that cross-talk has lines of its own
        f'excitation_{axis + 1}': {
            'frequency': arguments.frequency * (1.0 + 0.25 * axis),
            'folder': arguments.folder,
        }
        for axis in range(loaded.layout.inputs)
    }
    return {
        'simulator': {
            'clock': arguments.clock, 'preset': arguments.preset, 'wait_for': 1, 'rate': rate,
        },
        'control_loop': {
            'rate': rate, 'limits.low': low, 'limits.high': high, 'limits.slew': slew,
            'mode': 'reference', 'reference.amplitude': amplitude,
            **inside({'coupled': {'model_file': model}, **excited}),
        },
        'dashboard': {'folder': arguments.folder, 'port': arguments.port},
    }  # fmt: skip


def _reference(model: ModelFile | None, amplitude: float | None) -> tuple[float, float]:
    """Return mean and amplitude [m] of the reference; `amplitude` is given in µm."""
    mean, usual = usual_reference(model) if model else (0.0, 1.2e-4)
    return mean, usual if amplitude is None else 1e-6 * amplitude


def nodes(
    arguments: argparse.Namespace, model: str, rate: float, reference: tuple[float, float]
) -> dict[str, dict[str, object]]:
    """Return the parameters of every node; `rate` [Hz] and `reference` [m] are of the model."""
    readers = 3 if model else 2  # subscribers of the state; in lock-step tick 0 waits for them
    known: dict[str, object] = {'model_file': model} if model else {}  # ROS: no empty string
    timed: dict[str, object] = {'rate': rate}
    return {
        'simulator': {
            'clock': arguments.clock, 'preset': arguments.preset or ONE_AXIS,
            'wait_for': readers, **timed,
        },
        'control_loop': inside({
            'feedforward': {**(known or {'gain': 1.2857e-4}), **timed},
            'attenuation': {'enabled': bool(model), **known, **timed},
            'feedback': {**known, **timed},
            'excitation': {
                'mode': 'reference', 'frequency': arguments.frequency,
                'actuator': arguments.preset or ONE_AXIS, 'folder': arguments.folder,
                'reference.offset': reference[0], 'reference.amplitude': reference[1], **timed,
            },
        }),
        'identification': {'only_records': False, **timed},
        **({'gap_monitor': {**known, **timed}} if model else {}),
        'dashboard': {'folder': arguments.folder, 'port': arguments.port},
    }  # fmt: skip


def _print_addresses(group: NodeProcesses, arguments: argparse.Namespace, model: str) -> None:
    with ros_needed():
        from piezo_hysteresis.nodes.live import Observer
    with Observer(group) as observer:
        observer.until_ready('simulator')
        axes = observer.axes()
        if bool(axes) != is_modal(model) or (axes and axes != _axes_of(model)):
            raise PiezoError(
                f'the preset {arguments.preset or ONE_AXIS} has {counted(axes or 1, "axis")}, '
                f'the model {_axes_of(model) if is_modal(model) else 1}; give --preset of one '
                'with as many'
            )
        observer.until_ready('excitation_1' if axes else 'excitation', 'dashboard')
    print(f'open http://localhost:{arguments.port}/ (Ctrl-C ends the loop)', flush=True)
    if not model:
        print('no --model: nothing is compensated and no gap is watched', flush=True)


def _axes_of(model: str) -> int:
    from piezo_hysteresis.axes import modal_file

    return modal_file.load(model).layout.inputs

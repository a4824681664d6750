"""Find the effects that a model lacks by experiments on the running actuator.

Each experiment is selected by expected information gain per second, within the limits given here.
The excitation runs it. The investigation stops when an effect is confirmed, nothing is missing, or
the budget is spent. With --on each experiment is a wave in a controller, without nodes. The same
command continues an interrupted investigation; Ctrl-C brings the actuator to rest. --replay
repeats an investigation from its bags, without an actuator.
"""

from __future__ import annotations

import argparse
import math
import signal
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from piezo_hysteresis.cli.shared_options import ros_needed
from piezo_hysteresis.common.parameter_table import range_refusal
from piezo_hysteresis.drivers import Controller, measured, open_controller, write_measured
from piezo_hysteresis.drivers.addresses import FORMS, TAKE_OVER
from piezo_hysteresis.errors import PiezoError
from piezo_hysteresis.models import ModelFile
from piezo_hysteresis.process_setup import number_of_workers

if TYPE_CHECKING:
    from piezo_hysteresis.experiments.planned_experiment import PlannedExperiment
    from piezo_hysteresis.investigation.runner import Actuator, InvestigationProgress, Setup

#: Default sampling rate of an experiment [Hz].
RATE = 1000.0


class ControllerActuator:
    """A controller as the actuator of an investigation: each experiment is one wave."""

    def __init__(self, controller: Controller, rate: float = RATE) -> None:  # rate [Hz]
        servo = controller.identity.rate
        if not 0.0 < rate <= servo:
            raise PiezoError(f'--rate {rate:g}: give more than 0 and at most its {servo:g} Hz')
        self._controller = controller
        self._divider = max(1, round(servo / rate))
        self.rate = servo / self._divider

    def run(self, experiment: PlannedExperiment, bag: Path) -> bool:
        """Run an experiment into a new bag; return that the output rested at 0 V before it."""
        voltages = experiment.voltage(self.rate)
        record = measured(
            self._controller, experiment.name, voltages, experiment.info, self._divider
        )
        write_measured(bag, [record], self._controller.about())
        return True

    def apply(self, model: ModelFile) -> str:
        """Return an empty text, because no node uses the model."""
        return ''


Report = Callable[['InvestigationProgress'], None]


def run_on(arguments: argparse.Namespace, report: Report) -> tuple[str, Path]:
    """Investigate the actuator of a controller; return the result and its report."""
    model = _model(arguments)
    with open_controller(
        arguments.on,
        arguments.axis,
        arguments.low,
        arguments.high,
        arguments.slew or None,
        take_over=arguments.take_over,
    ) as controller:
        own = controller.limits
        actuator = ControllerActuator(controller, arguments.rate or RATE)
        setup = _setup(arguments, model, (own.low, own.high), own.slew, actuator.rate)
        controller.open_loop()
        return _conducted(Path(arguments.out), setup, actuator, report, arguments)


def run_on_nodes(arguments: argparse.Namespace, report: Report) -> tuple[str, Path]:
    """Investigate the actuator of the running nodes; return the result and its report."""
    model = _model(arguments)
    with ros_needed():
        from piezo_hysteresis.nodes.investigation.live_actuator import LiveActuator

    with LiveActuator(arguments.namespace, arguments.out) as nodes:

        def checked(progress: InvestigationProgress) -> None:
            nodes.check()
            report(progress)

        rate, slew = nodes.rate(), arguments.slew or math.inf
        setup = _setup(arguments, model, nodes.range(), slew, rate)
        with nodes.prepared(rate, slew):
            return _conducted(nodes.folder(), setup, nodes, checked, arguments)


def _model(arguments: argparse.Namespace) -> ModelFile:
    if not arguments.model:
        raise PiezoError('give the model in use: --model model/model.yaml')
    return ModelFile.load(arguments.model)


def _setup(
    arguments: argparse.Namespace,
    model: ModelFile,
    taken: tuple[float, float],  # range of the actuator [V]
    slew: float,  # [V/s]
    rate: float,  # [Hz]
) -> Setup:
    from piezo_hysteresis.experiments.planned_experiment import ExperimentLimits, granted_range
    from piezo_hysteresis.investigation.runner import Setup
    from piezo_hysteresis.investigation.session import Rules

    asked = (arguments.low or 0.0, arguments.high or 0.0)  # both 0: no limits given
    limits = ExperimentLimits(
        *granted_range(asked, taken, model),
        slew,
        arguments.max_frequency or ExperimentLimits.frequency,
        1e-6 * arguments.stroke or math.inf,
        arguments.heat or math.inf,
    )
    rules = Rules(
        budget=arguments.budget or Rules.budget,
        sure=arguments.sure or Rules.sure,
        seed=arguments.seed,
    )
    return Setup(model, limits, rules, rate)


def _conducted(
    out: Path, setup: Setup, actuator: Actuator, report: Report, arguments: argparse.Namespace
) -> tuple[str, Path]:
    from piezo_hysteresis.investigation import FOUND
    from piezo_hysteresis.investigation.runner import run_investigation

    workers = number_of_workers(arguments.workers)
    found = run_investigation(
        out, setup, actuator, report, workers=workers, apply=not arguments.no_apply
    )
    return found.words, out / FOUND / 'report.html'


EXAMPLE = 'investigate --model out/model/model.yaml --low -1 --high 1 --slew 50 --budget 60'


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of this verb."""
    add = parser.add_argument
    add('--model', metavar='YAML', help='model in use, without the missing effects')
    add(
        '--out',
        metavar='DIR',
        default='investigation',
        help='result folder, below the folder of the excitation; with --on any path',
    )
    add('--low', type=float, metavar='V', help='lowest voltage [V]; requires --high')
    add(
        '--high', type=float, metavar='V',
        help='highest voltage [V] (default: range of the actuator and the validated model)',
    )  # fmt: skip
    add(
        '--slew',
        type=float,
        default=0.0,
        metavar='V/S',
        help='slew rate limit [V/s] (default: that of the actuator)',
    )
    add(
        '--max-frequency',
        type=float,
        default=0.0,
        metavar='HZ',
        help='highest frequency of a drive [Hz] (default: 100)',
    )
    add(
        '--stroke',
        type=float,
        default=0.0,
        metavar='UM',
        help='largest range of displacement [µm] (default: no limit)',
    )
    add(
        '--heat', type=float, default=0.0, metavar='V2HZ',
        help='largest mean of frequency times amplitude squared [V²Hz] (default: no limit)',
    )  # fmt: skip
    add('--budget', type=float, default=0.0, metavar='S', help='actuator time [s] (default: 200)')
    add(
        '--sure',
        type=float,
        default=0.0,
        metavar='P',
        help='probability from which an effect counts as confirmed (default: 0.9)',
    )
    add('--seed', type=int, default=0, help='seed of all random choices')
    add('--workers', type=int, default=0, metavar='N', help='threads, 0 for one per core')
    add('--no-apply', action='store_true', help='do not change feedforward and gap monitor')
    add('--namespace', default='', help='namespace of the nodes')
    add('--on', metavar='ADDRESS', help=f'a controller instead of nodes: {FORMS}')
    add('--axis', default='1', help='axis of the controller')
    add('--take-over', action='store_true', help=TAKE_OVER)
    add(
        '--rate',
        type=float,
        metavar='HZ',
        help='with --on: sampling rate of the experiments [Hz] (default: 1000)',
    )
    add('--replay', metavar='FOLDER', help='repeat an investigation from its bags')


def run(arguments: argparse.Namespace) -> int:
    """Run or repeat an investigation."""
    if arguments.replay:
        return _replay(Path(arguments.replay), arguments.workers)
    if reason := range_refusal(arguments.low, arguments.high):
        raise PiezoError(reason)
    _require_used(arguments)
    # The actuator returns to rest after an interrupt and after termination.
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    printer = _ProgressPrinter()
    chosen = run_on_nodes if arguments.on is None else run_on
    found, report = chosen(arguments, printer.progress)
    printer.answer()
    print(found)
    print(f'open {report}')
    return 0


def _require_used(arguments: argparse.Namespace) -> None:
    """Reject node options with a controller, and controller options with nodes."""
    nodes = {'--namespace': bool(arguments.namespace), '--no-apply': arguments.no_apply}
    driver = {
        '--axis': arguments.axis != '1',
        '--rate': arguments.rate is not None,
        '--take-over': arguments.take_over,
    }
    unused, way = (driver, 'without --on') if arguments.on is None else (nodes, 'with --on')
    if names := [name for name, given in unused.items() if given]:
        raise PiezoError(f'{", ".join(names)}: not used {way}; leave it out')


class _ProgressPrinter:
    """Prints each experiment with its result once."""

    def __init__(self) -> None:
        self._asked, self._answer = ('', 0), ''
        self._printed = ''

    def progress(self, progress: InvestigationProgress) -> None:
        """Print the progress."""
        self._answer = progress.answer
        if (
            progress.stage not in ('run', 'apply')
            or (progress.stage, progress.number) == self._asked
        ):
            return
        self.answer()
        self._asked = progress.stage, progress.number
        shown = list(progress.chances.items())[:3]
        chances = ', '.join(f'{name} {chance:.2g}' for name, chance in shown)
        word = f'{progress.number}.' if progress.stage == 'run' else 'afterwards'
        print(f'{word} {progress.experiment}: {progress.why} (so far: {chances})', flush=True)

    def answer(self) -> None:
        """Print the result of the last experiment, once."""
        if self._answer and self._answer != self._printed:
            self._printed = self._answer
            print(f'   {self._answer}', flush=True)


def _replay(folder: Path, workers: int) -> int:
    from piezo_hysteresis.investigation.runner import repeated

    def report(progress: InvestigationProgress) -> None:
        if progress.stage == 'judge':
            print(f'{progress.number}. {progress.experiment}: {progress.why}', flush=True)

    found = repeated(folder, number_of_workers(workers), report)
    if found.differences:
        raise PiezoError(f'{folder}: {"; ".join(found.differences)}')
    last = found.lines[-1] if found.lines else None
    if last is None:
        raise PiezoError(f'{folder} holds no experiment yet')
    print(f'   {last["answer"]}')
    print(found.stop.words if found.stop else 'interrupted: investigate continues from here')
    print(f'the same choices and the same names as in {folder}')
    return 0

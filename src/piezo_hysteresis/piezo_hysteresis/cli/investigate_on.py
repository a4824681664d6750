"""``investigate --on``: an investigation with experiments in a motion controller."""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from piezo_hysteresis.drivers import Controller, measured, open_controller, write_measured
from piezo_hysteresis.errors import PiezoError
from piezo_hysteresis.models import ModelFile
from piezo_hysteresis.process_setup import number_of_workers

if TYPE_CHECKING:
    from piezo_hysteresis.experiments.planned_experiment import PlannedExperiment
    from piezo_hysteresis.investigation.runner import InvestigationProgress

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


def run_on(
    arguments: argparse.Namespace, report: Callable[[InvestigationProgress], None]
) -> tuple[str, Path]:
    """Investigate the actuator of a controller; return the result and its report."""
    from piezo_hysteresis.experiments.experiment_limits import ExperimentLimits, granted_range
    from piezo_hysteresis.investigation.journal import Setup
    from piezo_hysteresis.investigation.runner import FOUND, conduct
    from piezo_hysteresis.investigation.session import Rules

    if not arguments.model:
        raise PiezoError('give the model in use: --model model/model.yaml')
    model, out = ModelFile.load(arguments.model), Path(arguments.out)
    with open_controller(
        arguments.on,
        arguments.axis,
        arguments.low,
        arguments.high,
        arguments.slew or None,
        take_over=arguments.take_over,
    ) as controller:
        own = controller.limits
        asked = (arguments.low or 0.0, arguments.high or 0.0)
        limits = ExperimentLimits(
            *granted_range(asked, (own.low, own.high), model),
            own.slew,
            arguments.max_frequency or ExperimentLimits.frequency,
            1e-6 * arguments.stroke or math.inf,
            arguments.heat or math.inf,
        )
        rules = Rules(
            budget=arguments.budget or Rules.budget,
            sure=arguments.sure or Rules.sure,
            seed=arguments.seed,
        )
        actuator = ControllerActuator(controller, arguments.rate or RATE)
        controller.open_loop()
        found = conduct(
            out,
            Setup(model, limits, rules, actuator.rate),
            actuator,
            report,
            workers=number_of_workers(arguments.workers),
        )
    return found.words, out / FOUND / 'report.html'

"""What the identification node does with each sample and marker; knows no ROS."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from piezo_hysteresis.errors import IdentificationError
from piezo_hysteresis.identification.estimate import Estimate
from piezo_hysteresis.identification.online import OnlineMethod, online, settled
from piezo_hysteresis.identification.rls import RlsSettings
from piezo_hysteresis.identification.rls_ud import OnlineUd, UdSettings
from piezo_hysteresis.models import Model, ModelFile, Provenance, named
from piezo_ros_common.order import Intake

# Free runs of `rls` start at the beginning of the record; beyond this time none is made [s].
LONGEST_RUN = 60.0

# Where the forgetting factor is left to the method.
FORGETTING = {'rls': 1.0, 'rls_ud': 0.9999, 'pi_bank': 0.9999}

_RLS = ('variant', 'offset', 'harmonic', 'frequency', 'unit')
_UD = ('voltage_range', 'displacement_range', 'natural_frequency', 'damping_ratio', 'quiet')
SETTINGS = ('method', *_RLS, *_UD)


def forgetting_of(values: Mapping[str, Any]) -> float:
    """Return the forgetting factor in force; 0 leaves it to the method."""
    return float(values['forgetting']) or FORGETTING[values['method']]


def new_method(values: Mapping[str, Any]) -> OnlineMethod:
    """Return the method that the parameters of the node describe.

    Raises
    ------
    IdentificationError
        If they do not go together.
    """
    method = values['method']
    common: dict[str, Any] = {
        'forgetting': forgetting_of(values),
        'dt': 1.0 / float(values['rate']),
    }
    settings: RlsSettings | UdSettings
    if method == 'rls':
        settings = RlsSettings(**{name: values[name] for name in _RLS}, **common)
    else:
        kind = 'play_bank' if method == 'pi_bank' else 'bouc_wen'
        settings = UdSettings(kind=kind, **{name: values[name] for name in _UD}, **common)
    recursion = online(method, settings)
    if not 0.5 < settings.forgetting <= 1.0:
        raise IdentificationError(
            f'forgetting = {settings.forgetting:g} remembers nothing; stay above 0.5, or give 0 '
            "for the method's own"
        )
    return recursion


@dataclass(frozen=True)
class Edge:
    """The start of a record, or its end where it has no name."""

    nanoseconds: int
    record: str


@dataclass
class Course:
    """Feeds a method with the samples that lie in records, each from rest.

    Without any marker everything is one record. Samples between the end of a record and the
    start of the next are left out, as they are when the bag is read.

    Attributes
    ----------
    method : OnlineMethod
        What is fed.
    rate : float
        Sampling rate [Hz].
    only_records : bool
        False takes the samples between records in too.
    refused : int
        Samples left out because a number is none.
    intake : Intake
        Judges the numbers of the samples.
    """

    method: OnlineMethod
    rate: float
    only_records: bool = True
    refused: int = 0
    intake: Intake = field(default_factory=Intake)
    _edges: deque[Edge] = field(default_factory=deque)
    _open: bool = True
    _voltage: list[float] = field(default_factory=list)
    _displacement: list[float] = field(default_factory=list)
    _before: Estimate | None = None

    def mark(self, edge: Edge) -> None:
        """Note an edge; it acts on the samples from its time on."""
        self._edges.append(edge)

    def take(self, sample: int, nanoseconds: int, voltage: float, displacement: float) -> bool:
        """Take one sample in; return False where it is left out."""
        while self._edges and self._edges[0].nanoseconds <= nanoseconds:
            self._open = bool(self._edges.popleft().record)
            self._rest()
        newest = self.intake.newest
        if not self.intake.take(sample):
            return False
        if sample < newest:
            self._rest()
        if self.only_records and not self._open:
            return False
        if not (math.isfinite(voltage) and math.isfinite(displacement)):
            self.refused += 1
            return False
        self.method.update(voltage, displacement)
        if len(self._voltage) < LONGEST_RUN * self.rate:
            self._voltage.append(voltage)
            self._displacement.append(displacement)
        return True

    def change(self, method: OnlineMethod) -> None:
        """Go on with another method, which knows nothing yet."""
        self.method = method
        self._before = None

    def reset(self) -> None:
        """Forget what was learnt, and that there were records."""
        self.method.reset()
        self._open = True
        self._before = None

    def settled(self, estimate: Estimate) -> bool:
        """Tell whether the estimate stood still since this was asked last."""
        before, self._before = self._before, estimate
        if before is None or before.names != estimate.names:
            return False
        return settled(before, estimate)

    def free_run_rms(self, estimate: Estimate) -> float:
        """Return the rms free-run error over the last second [m], NaN where it is not known."""
        if isinstance(self.method, OnlineUd):
            return estimate.one_step_rms  # its predictions are those of the free run
        count = len(self._voltage)
        if count < 2 or count >= LONGEST_RUN * self.rate:
            return math.nan
        with np.errstate(all='ignore'):
            free = self.method.free_run(np.array(self._voltage))
            last = slice(-round(self.rate), None)
            error = free[last] - np.array(self._displacement[last])
            rms = float(np.sqrt(np.nanmean(error**2)))
        return rms if math.isfinite(rms) else math.inf

    def model(self, estimate: Estimate) -> Model | None:
        """Return the chain whose parameters the method estimates, None where there is none."""
        if isinstance(self.method, OnlineUd):
            return self.method.model()
        return named(estimate.model) if estimate.model else None

    def model_file(self, fit: str) -> ModelFile:
        """Return the present estimate as it is saved.

        Raises
        ------
        PiezoError
            If it is no model that can be used.
        """
        estimate = self.method.estimate()
        model = self.model(estimate)
        if model is None:
            raise IdentificationError('no named model has the form of V0; use V1 or V2')
        deviations = {
            name: float(value)
            for name, value in zip(estimate.names, estimate.standard_deviations, strict=True)
            if math.isfinite(value)
        }
        values = {**model.defaults(), **estimate.parameters()}
        provenance = Provenance(fit=fit, rate=self.rate, notes={'samples': estimate.samples})
        return ModelFile(model, values, deviations, provenance)

    def _rest(self) -> None:
        self.method.rest()
        self.intake.newest = -1
        self._voltage.clear()
        self._displacement.clear()

"""What a baseline settled alone is settled again with the effect, and zeros pass for none."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from piezo_hysteresis.discovery import discover
from piezo_hysteresis.discovery.data.annotate import annotated
from piezo_hysteresis.discovery.data.dataset import split
from piezo_hysteresis.discovery.selection.anew import by_other_loops
from piezo_hysteresis.discovery.selection.candidate_fit import CandidateFit, ModelSpec
from piezo_hysteresis.discovery.selection.free import FreeEvaluator
from piezo_hysteresis.discovery.selection.start import zeros_apart
from piezo_hysteresis.identification.circumstances import Choices
from piezo_hysteresis.identification.output_error import suited
from piezo_hysteresis.models import named
from piezo_hysteresis.records import Record
from piezo_sim.sweep import simulate

HIDDEN = {'effects.sensor_nonlinearity': True}
PLAN = [
    {'kind': 'sine', 'frequency': f, 'amplitude': a, 'duration': 1.0}
    for f, a in ((2, 1.0), (7, 0.5), (19, 1.0), (43, 0.7))
]
#: Shares of the largest stroke by which a sensor was shifted between the records.
SHIFTS = (0.05, -0.04, 0.0, 0.07)
#: A loop far too slow, from which a fit comes back, and one far too fast, from which none does.
SLOW = {'beta': 0.02, 'gamma': -0.01}
FAST = {'beta': 8.0, 'gamma': 5.0}


@pytest.fixture(scope='module')
def records() -> list[Record]:
    return simulate('generic_bouc_wen', PLAN, HIDDEN, 2)


def shifted(records: list[Record]) -> list[Record]:
    stroke = max(float(np.ptp(r.displacement)) for r in records)
    return [
        replace(r, displacement=r.displacement + shift * stroke)
        for r, shift in zip(records, SHIFTS, strict=True)
    ]


def scene(
    records: list[Record], astray: dict[str, float] = SLOW
) -> tuple[FreeEvaluator, CandidateFit, CandidateFit]:
    """Return a baseline whose loop is far off, and the same with the effect that it lacks."""
    model = suited(named('classical'), records)
    start = ModelSpec(model, model.defaults() | astray)
    evaluator = FreeEvaluator(split(records), 0, 1, choices=Choices())
    found = next(
        c for c in evaluator.candidates(start) if c.effect.variant == 'sensor_nonlinearity'
    )
    known = start.with_candidate(found, found.values(start.values, found.starts[0]))
    return evaluator, evaluator.judged(start), evaluator.judged(known)


def test_a_loop_that_is_far_off_is_found_with_the_effect(records: list[Record]) -> None:
    evaluator, start, known = scene(records, FAST)
    fit = evaluator.refit(known)
    assert fit.floors > 10.0
    found = by_other_loops(evaluator, fit, start)
    assert found.floors < 1.1
    assert found.values['beta'] == pytest.approx(1.2, rel=0.02)
    assert [added.effect for added in found.added] == ['sensor_nonlinearity']


def test_zeros_that_lie_apart_pass_for_no_effect(records: list[Record]) -> None:
    data = split(annotated(shifted(records)))
    assert zeros_apart(Choices(), data).zero == 'record'
    assert zeros_apart(Choices(zero='common'), data).zero == 'common'
    found = discover(shifted(records), named('classical'), seed=1)
    assert [effect.name for effect in found.verdict.effects] == ['sensor_nonlinearity']
    assert found.verdict.held_out.after_in_floors < 1.1


def test_one_record_has_the_zero_of_its_model(records: list[Record]) -> None:
    assert zeros_apart(Choices(), split(annotated(records[:1]))).zero == 'auto'


def test_what_leaves_noise_alone_stays_as_it_is(records: list[Record]) -> None:
    evaluator, start, known = scene(records)
    fit = evaluator.refit(known)
    assert fit.floors < 1.1
    told, found = evaluator.settled(fit, start)
    assert told is evaluator
    assert found is fit

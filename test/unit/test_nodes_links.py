"""The ROS-free parts of the links: hand-over of inverses and laws, ticks brought together."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np
import pytest

from piezo_hysteresis.compensation.controllers import Controllers
from piezo_hysteresis.compensation.inverses.inverse_choice import inverse_for
from piezo_hysteresis.compensation.inverses.inverse_link import HISTORY
from piezo_hysteresis.compensation.link import CrossFade, Limits, Measured, ReferencePoint
from piezo_hysteresis.errors import PiezoError
from piezo_hysteresis.models import ModelFile, named
from piezo_hysteresis.runtime.laws import Inversion
from piezo_hysteresis.runtime.synchronizer import LONGEST, SampleSynchronizer

DT = 1e-3
LIMITS = Limits(-1.2, 1.2, 2000.0)


def points(count: int, first: int = 0) -> list[ReferencePoint]:
    w = 2 * np.pi * 5.0
    t = (first + np.arange(count)) * DT
    x, v, a = 1e-4 * np.sin(w * t), 1e-4 * w * np.cos(w * t), -1e-4 * w * w * np.sin(w * t)
    return [
        ReferencePoint(first + k, float(x[k]), float(v[k]), float(a[k]), 5.0, 0.0)
        for k in range(count)
    ]


def model(name: str, **values: float) -> ModelFile:
    chosen = named(name)
    usual = {'A1': 1e-4, 'A': 2e-5, 'beta': 0.6, 'gamma': 0.1}
    known = {key: v for key, v in {**usual, **values}.items() if key in chosen.parameter_names}
    return ModelFile(chosen, {**chosen.defaults(), **known})


def test_a_new_chain_takes_over_as_if_it_had_always_been_there() -> None:
    inversion = Inversion(Controllers(DT, LIMITS, start=0.0, transition=0.1))
    assert inversion.voltage(points(1)[0]) is None
    inversion.restart()
    assert inversion.take(model('classical'))
    for point in points(HISTORY - 200):
        inversion.voltage(point)
    assert inversion.take(model('bouc_wen_mode', natural_frequency=70.0, damping_ratio=0.02))
    got = [inversion.voltage(point) for point in points(200, HISTORY - 200)]
    loaded = inversion.loaded
    assert loaded is not None
    fresh = inverse_for(loaded.model, loaded.values, DT, limits=LIMITS, start=0.0)
    expected = [fresh.step(point) for point in points(HISTORY)]
    assert got == expected[-200:]


def test_the_same_chain_goes_over_by_itself() -> None:
    inversion = Inversion(Controllers(DT, LIMITS, start=0.0, transition=0.1))
    inversion.take(model('classical'))
    before = [inversion.voltage(point) for point in points(300)]
    assert not inversion.take(model('classical', A1=1.3e-4))
    after = inversion.voltage(points(1, 300)[0])
    assert after is not None
    assert before[-1] is not None
    assert abs(after - before[-1]) < 0.05


def test_a_model_without_an_inverse_leaves_the_one_before() -> None:
    inversion = Inversion(Controllers(DT, LIMITS, start=0.0, transition=0.1))
    good = model('classical')
    inversion.take(good)
    with pytest.raises(PiezoError):
        inversion.take(model('classical', A1=1e-5))
    assert inversion.loaded is good
    assert inversion.voltage(points(1)[0]) is not None


def test_a_crossfade_begins_at_the_last_share_and_ends_at_the_new_one() -> None:
    fade = CrossFade(DT, 0.05)
    fade.start()
    assert fade.apply(0.5) == 0.5  # nothing to go over from
    fade.start()
    shares = [fade.apply(-1.0) for _ in range(60)]
    assert shares[0] == 0.5
    assert shares[-1] == -1.0
    assert np.all(np.diff(shares) <= 0.0)
    assert np.abs(np.diff(shares)).max() < 1.875 * 1.5 * DT / 0.05 * 1.01


def test_a_book_answers_each_tick_once_in_any_order() -> None:
    rng = np.random.default_rng(1)
    for _ in range(20):
        book: SampleSynchronizer[str] = SampleSynchronizer()
        calls: list[Callable[[], object]] = []
        for k, point in enumerate(points(5)):
            calls += [
                partial(book.add_reference, point),
                partial(book.add_voltage, k, 0.1 * k, 'tag'),
                partial(book.add_measured, Measured(k, 0.0, 1e-6 * k)),
            ]
        # In lock-step nothing of tick k comes before tick k - 1 was answered.
        answered = []
        for k in range(5):
            own = [calls[3 * k], calls[3 * k + 1], *([calls[3 * k - 1]] if k else [])]
            rng.shuffle(own)
            for add in own:
                add()
                while (tick := book.take()) is not None:
                    answered.append(tick)
        assert [tick.point.sample for tick in answered] == list(range(5))
        assert [tick.received for tick in answered] == [0.1 * k for k in range(5)]
        newest = [tick.measured and tick.measured.sample for tick in answered]
        assert newest == [None, 0, 1, 2, 3]


def test_a_book_without_voltages_stays_small() -> None:
    book: SampleSynchronizer[str] = SampleSynchronizer()
    for point in points(3 * LONGEST):
        book.add_reference(point)
        book.add_measured(Measured(point.sample, 0.0, 0.0))
    assert book.waiting <= 2 * LONGEST
    held: SampleSynchronizer[str] = SampleSynchronizer()
    for point in points(3):
        held.add_reference(point)
    for k in range(5):
        held.add_voltage(k, 0.1, 'tag')
    held.add_measured(Measured(0, 0.0, 0.0))
    assert held.waiting == 3 + 5 + 1

"""Harmonics that follow laws of time: the same as rows that are stored, without their memory."""

import tracemalloc

import numpy as np
import pytest

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.numerics.harmonics import ModulatedLines
from piezo_hysteresis.numerics.qr import orthonormal, projected_out

HIGHEST, DEPENDENT = 12, 1e-6
#: Of a fundamental whose period wanders.
PHASE: FloatArray = 2 * np.pi / 97.3 * np.arange(60_000.0)
PHASE += 0.2 * np.sin(PHASE / 9.7)


def laws(count: int) -> np.ndarray:
    size = np.linspace(0.3, 1.0, count) ** 2
    return np.array([np.ones(count), size, size**2])


def rows(of: np.ndarray) -> np.ndarray:
    angle = PHASE[: of.shape[1]]
    found = list(of)
    for n in range(1, HIGHEST + 1):
        for law in of:
            found += [law * np.cos(n * angle), law * np.sin(n * angle)]
    return np.array(found)


@pytest.mark.parametrize(
    'of', [laws(1500), laws(1500)[:1], np.vstack([laws(1500)[:2], 2.0 - laws(1500)[1]])],
    ids=['growing', 'steady', 'a law that depends on others'],
)  # fmt: skip
def test_sums_give_what_stored_rows_give(of: np.ndarray) -> None:
    rng = np.random.default_rng(0)
    error = rng.standard_normal(1500) + of[-1] * np.cos(3 * PHASE[:1500])
    error -= error.mean()
    shares, left = ModulatedLines(of.copy(), PHASE[: of.shape[1]], HIGHEST, DEPENDENT).split(error)
    expected, rest = projected_out(error, orthonormal(rows(of), DEPENDENT)[1:])
    assert np.max(np.abs(left - rest)) < 1e-9
    # one order, of which all rows are orthogonal to those of the others
    orders = ModulatedLines(of.copy(), PHASE[: of.shape[1]], HIGHEST, DEPENDENT).orders
    powers = [np.bincount(orders, each**2) for each in (shares, expected)]
    assert powers[0] == pytest.approx(powers[1], rel=1e-9)


def test_memory_is_that_of_the_laws_and_not_of_the_lines() -> None:
    def peak(count: int) -> int:
        of, error, phase = laws(count), np.ones(count), PHASE[:count]
        tracemalloc.start()
        ModulatedLines(of, phase, HIGHEST, DEPENDENT).split(error)
        top = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        return top

    peak(1000)
    assert (peak(60_000) - peak(20_000)) / 40_000 < 8 * 3  # 75 lines would be 600 bytes

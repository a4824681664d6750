"""What a soak calls flat, on memories made up for it."""

from __future__ import annotations

import os
from mmap import MAP_ANONYMOUS, MAP_PRIVATE, MAP_SHARED, mmap
from pathlib import Path

import numpy as np
import pytest

from bench.soak import MIB, judge, sample_of

SECONDS = np.arange(0.0, 1800.0, 1.0)


def memory(private: np.ndarray, handles: int = 18) -> np.ndarray:
    """Return samples of a process whose private part is given [byte], shape (n, 4)."""
    shared = np.full_like(private, 2.0 * MIB)
    return np.stack([private + shared, private, shared, np.full_like(private, handles)], axis=1)


def noisy(mean: np.ndarray, seed: int = 1) -> np.ndarray:
    noise = np.random.default_rng(seed).normal(scale=0.02 * MIB, size=mean.size)
    return np.asarray(mean * MIB + noise)


def test_what_stays_is_flat() -> None:
    verdict = judge(SECONDS, memory(noisy(np.full(1800, 80.0))))
    assert verdict.flat
    assert verdict.low < 0.0 < verdict.high
    assert verdict.rss == pytest.approx(82.0 * MIB, rel=1e-3)
    assert judge(SECONDS, memory(np.full(1800, 80.0 * MIB))).flat  # no page more or less


def test_what_is_filled_at_the_start_is_flat() -> None:
    settling = 80.0 + 10.0 * (1.0 - np.exp(-SECONDS / 60.0))
    assert judge(SECONDS, memory(noisy(settling))).flat


def test_a_leak_is_found_and_known_to_be_private() -> None:
    verdict = judge(SECONDS, memory(noisy(80.0 + 3.0 * SECONDS / 3600.0)))
    assert not verdict.flat
    assert verdict.slope == pytest.approx(3.0 * MIB, rel=0.05)
    assert verdict.private == pytest.approx(3.0 * MIB, rel=0.05)
    assert verdict.shared == 0.0


def test_a_handle_gained_is_not_flat() -> None:
    samples = memory(np.full(1800, 80.0 * MIB))
    samples[1500:, 3] += 1
    verdict = judge(SECONDS, samples)
    assert not verdict.flat
    assert (verdict.handles_first, verdict.handles_last) == (18, 19)


def test_a_process_is_looked_at() -> None:
    size = 32 * MIB  # mapped anew: what the heap still has from before would not count
    before = sample_of(os.getpid())
    with Path(os.devnull).open(), mmap(-1, size, flags=MAP_PRIVATE | MAP_ANONYMOUS) as own:
        own.write(bytes(size))
        with mmap(-1, size, flags=MAP_SHARED | MAP_ANONYMOUS) as common:
            common.write(bytes(size))
            after = sample_of(os.getpid())
    assert after.private - before.private >= 0.9 * size
    assert after.shared - before.shared >= 0.9 * size
    assert after.handles == before.handles + 1
    assert after.rss >= after.private + after.shared

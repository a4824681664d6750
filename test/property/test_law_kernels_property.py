"""Laws that are kernels answer what the plain recursions of their papers do, to the last bit."""

from __future__ import annotations

from typing import Any

from hypothesis import given
from hypothesis import strategies as st

from piezo_hysteresis.compensation.link import CrossFade
from piezo_hysteresis.numerics.smooth import smooth_step

DT = 1e-3


@given(
    shares=st.lists(st.floats(-2.0, 2.0), min_size=5, max_size=80),
    starts=st.sets(st.integers(0, 80)),
    duration=st.sampled_from([0.0, 0.004, 0.05]),
)
def test_a_crossfade_has_the_bits_of_its_formula(shares: Any, starts: Any, duration: Any) -> None:
    fade, elapsed, before, last = CrossFade(DT, duration), None, 0.0, None
    for k, raw in enumerate(shares):
        if k in starts:
            fade.start()
            if last is not None:
                before, elapsed = last, 0
        last = raw
        if elapsed is not None:
            done = elapsed * DT / max(duration, DT)
            last = before + smooth_step(done)[0] * (raw - before)
            elapsed = None if done >= 1.0 else elapsed + 1
        assert fade.apply(raw) == last

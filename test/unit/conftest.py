"""A unit test is short: what takes a second of processor time is marked as a component test."""

from __future__ import annotations

import os
from collections.abc import Iterator

import pytest

MOST = 1.0
SLOWER = ('component', 'slow')


@pytest.fixture(scope='session', autouse=True)
def _imported() -> None:
    """Import what takes long to import, so that no test is charged for being the first."""
    import scipy.optimize
    import scipy.signal
    import scipy.stats  # noqa: F401


@pytest.hookimpl(wrapper=True)
def pytest_runtest_call(item: pytest.Item) -> Iterator[None]:
    """Fail a test that takes more processor time than a unit test may, children included."""
    begun = sum(os.times()[:4])
    yield
    spent = sum(os.times()[:4]) - begun
    item.user_properties.append(('processor_s', f'{spent:.2f}'))
    if spent > MOST and not any(map(item.get_closest_marker, SLOWER)):
        pytest.fail(
            f'{spent:.1f} s of processor time: a unit test takes {MOST:g} s at the most. Make it '
            'smaller, or mark it as component (part of make test) or slow (make studies)'
        )

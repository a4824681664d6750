"""Rows of the leaderboard: every one of its page comes from the script."""

from __future__ import annotations

from studies.worlds import mirror
from studies.worlds.leaderboard import CASES, rivals


def test_a_peer_of_periodic_records_is_asked_where_they_are() -> None:
    by_title = {case.title: rivals(case) for case in CASES}
    asked = {title for title, tools in by_title.items() if 'freq-statespace, NL-LFR' in tools}
    assert asked == {case.title for case in CASES if case.periods}
    assert all('nfoursid, linear' in tools for tools in by_title.values())


def test_a_quick_run_of_the_mirror_has_one_level() -> None:
    assert len(mirror.QUICK['levels']) == 1
    assert set(mirror.QUICK['levels']) < set(mirror.LEVELS)

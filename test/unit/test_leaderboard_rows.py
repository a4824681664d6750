"""Rows of the leaderboard: every one of its page comes from the script."""

from __future__ import annotations

import json
from math import inf, nan
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bench.quick import ROOT
from studies.peers import run as peers
from studies.worlds import leaderboard, mirror
from studies.worlds.leaderboard import CASES, PUBLISHED, RESULTS, RIVALS, Row, rivals

PAGE = ROOT / 'docs' / 'leaderboard.md'


def kept() -> dict[str, Any]:
    found: dict[str, Any] = json.loads(RESULTS.read_text('utf-8'))
    return found


def test_a_peer_of_periodic_records_is_asked_where_they_are() -> None:
    by_title = {case.title: rivals(case) for case in CASES}
    asked = {title for title, tools in by_title.items() if 'freq-statespace, NL-LFR' in tools}
    assert asked == {case.title for case in CASES if case.periods}
    assert all('nfoursid, linear' in tools for tools in by_title.values())


def test_a_quick_run_of_the_mirror_has_one_level() -> None:
    assert len(mirror.QUICK['levels']) == 1
    assert set(mirror.QUICK['levels']) < set(mirror.LEVELS)


def test_the_page_shows_the_rows_of_one_run() -> None:
    page, results = PAGE.read_text('utf-8'), kept()
    assert leaderboard.written(page, results) == page
    titles = {*results['rows'], *PUBLISHED}
    assert page.count('<!-- rows: ') == len(titles) == page.count('<!-- end -->') - 1
    assert not results['made']['commit'].endswith('+')  # nothing uncommitted took part


def test_every_tool_of_a_case_has_a_row_and_its_settings() -> None:
    page, rows = PAGE.read_text('utf-8'), leaderboard.rows_of(kept())
    settings = page[page.index('## Settings') : page.index('## Stack')]
    for case in CASES:
        assert set(rivals(case)) <= rows[case.title].keys()
    for tool in RIVALS:
        assert f'| {tool} |' in settings


def test_a_tool_that_has_the_true_equation_is_marked() -> None:
    page = PAGE.read_text('utf-8')
    for tool in leaderboard.TRUE_STRUCTURE:
        assert f'| {tool} (**true structure**) |' in page


def test_a_table_has_the_best_first_and_leaves_out_what_is_unknown() -> None:
    rows = {
        'a': Row(3, 12.4, 'one', {'x': 2e-7, 'y': inf}),
        'b (published)': Row(0, nan, '', {'x': 1e-7}),
    }
    assert leaderboard.table(rows)[2:] == [
        '| b (published) | 0.100 |  |  |  |  |',
        '| a | 0.200 | diverges | 3 | 12 | one |',
    ]
    page = 'before\n<!-- rows: A -->\nold\n<!-- end -->\n<!-- rows: B -->\n<!-- end -->\n'
    made = {'date': 'd', 'minutes': 1.0, 'commit': 'c', 'seed': 0, 'machine': 'm'}
    plain = {'a': {'parameters': 3, 'seconds': 1.0, 'words': 'one', 'errors': {'x': 2e-7}}}
    filled = leaderboard.written(page, {'made': made, 'rows': {'A': plain}})
    assert '| a | 0.200 | 3 | 1 | one |' in filled
    assert 'old' not in filled
    assert filled.endswith('<!-- rows: B -->\n<!-- end -->\n')


# Peers: what is not their own library


def task(u: np.ndarray, y: np.ndarray, known: int, **more: Any) -> Any:
    """Return a task of one record, whose first samples are known."""
    shown = y.copy()
    shown[known:] = np.nan
    given = {'period': 0, 'quick': True, 'periods': 0} | more
    return peers.Task(
        0.01, voltage=[u, u], displacement=[shown, shown], half_ranges=(1.0, 1.0),
        middles=(0.0, 0.0), **given,
    )  # fmt: skip


def test_a_peer_answers_without_what_is_kept_from_it(tmp_path: Path) -> None:
    u = 3.0 * np.sin(0.1 * np.arange(400.0)) + 1.0
    known = np.where(np.arange(400) < 300, 2.0 * u, np.nan)
    np.savez(
        tmp_path / 'task.npz', dt=0.01, period=63, quick=True, periods=0, count=2,
        voltage_0=u, displacement_0=known, voltage_1=u, displacement_1=known,
    )  # fmt: skip
    read = peers.read(tmp_path / 'task.npz')
    assert read.known[0].size == 300
    assert np.max(np.abs(read.known[1])) == pytest.approx(1.0)
    assert peers.begins_at(read.displacement[1]) == 299


def test_the_published_equation_follows_its_own_solution() -> None:
    time = 0.01 * np.arange(900)
    u = 150.0 * np.sin(2.0 * np.pi * time)
    one, y1, u1, slope1, yy = peers.PUBLISHED
    slope, y = np.gradient(u, 0.01), np.zeros(900)
    for k in range(899):  # a step of the midpoint rule
        middle = y[k]
        for _ in range(8):
            rate = one + y1 * middle + yy * middle * abs(middle)
            rate += 0.5 * (u1 * (u[k] + u[k + 1]) + slope1 * (slope[k] + slope[k + 1]))
            middle = y[k] + 0.005 * rate
        y[k + 1] = 2.0 * middle - y[k]
    given = task(u, 1e-6 * y, known=750)
    (run,) = peers.pysindy_published(given).runs
    assert np.isnan(run[:700]).all()
    assert peers.rms(1e6 * run[700:] - y[700:]) < 0.02


def test_the_recursion_of_a_polynomial_starts_from_known_samples() -> None:
    u = np.sin(0.3 * np.arange(60))
    y = np.zeros(60)
    for k in range(2, 60):
        y[k] = 0.7 * y[k - 1] - 0.2 * y[k - 2] + 0.5 * u[k - 1] - 0.1 * y[k - 1] ** 3
    powers = np.array([[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [3, 0, 0, 0]])
    weights, shown = np.array([0.7, -0.2, 0.5, -0.1]), y.copy()
    shown[30:] = np.nan
    run = peers.recursion(powers, weights, u, shown)
    assert run[30:] == pytest.approx(y[30:])


def test_a_linear_system_starts_where_the_known_samples_say() -> None:
    system = [np.array([[0.9, 0.2], [0.0, 0.7]]), np.array([[0.0], [1.0]]),
              np.array([[1.0, 0.0]]), np.array([[0.0]])]  # fmt: skip
    u = np.random.default_rng(1).standard_normal(80)
    y = peers.linear_run(system, np.array([3.0, -2.0]), u)
    shown = y.copy()
    shown[40:] = np.nan
    found = peers.linear_run(system, peers.start_of(system, u, shown), u)
    assert found == pytest.approx(y)


def test_the_mean_of_steady_periods_keeps_the_signal() -> None:
    one = np.sin(2.0 * np.pi * np.arange(50) / 50)
    noise = 0.1 * np.random.default_rng(2).standard_normal(250)
    given = task(np.tile(one, 5), np.tile(one, 5) + noise, known=250, periods=5)
    u, y = given.period_mean
    assert u == pytest.approx(one)
    assert peers.rms(y - one) == pytest.approx(0.1 / 5**0.5, rel=0.3)

"""The results of the discovery tests: file, counts and the page with its tables."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import pytest

from studies import exams
from studies.exams import Exam, hits, key_of, read, written

sys.path.insert(0, str(exams.ROOT / 'tools'))
import write_exams

EVERY = read()
LISTED = [each for each in EVERY if 'right' in each.get('rows', [{}])[0]]


def test_the_file_is_written_as_it_is_read_and_has_each_exam_once() -> None:
    assert written(EVERY) == exams.FILE.read_text('utf-8')
    assert len({key_of(each) for each in EVERY}) == len(EVERY)
    assert all(set(each.get('counts', ())) <= set(exams.COUNTS) for each in EVERY)


@pytest.mark.parametrize('exam', LISTED, ids=lambda each: str(key_of(each)))
def test_counts_agree_with_the_sets_that_are_listed(exam: dict[str, Any]) -> None:
    pairs = [row for row in exam['rows'] if ' and ' in row['hidden']]
    null = [row for row in exam['rows'] if row['hidden'] == 'nothing']
    outside = [row for row in exam['rows'] if row['hidden'] in ('dead band', 'heating')]
    known = [id(row) for row in (*pairs, *null, *outside)]
    single = [row for row in exam['rows'] if id(row) not in known]
    kinds = {'first': single, 'pairs': pairs, 'none': null, 'outside': outside}
    for key, rows in kinds.items():
        right = [row['right'] for row in rows for _ in range(row.get('sets', 1))]
        assert tuple(exam['counts'].get(key, (0, 0))) == hits(right)


def test_an_exam_is_stored_in_place_of_the_same_one(tmp_path: Path) -> None:
    path = tmp_path / 'exams.json'
    path.write_text('[]', 'utf-8')
    for first in (1, 2):
        for seed in (7, 8):
            Exam('hidden', seed, {'first': (first, 3)}, [{'hidden': 'lag'}]).store(path)
    assert [each['seed'] for each in read(path)] == [7, 8]
    assert [each['counts']['first'] for each in read(path)] == [[2, 3], [2, 3]]
    assert all(each['search'] == 'present' and each['variant'] == '' for each in read(path))
    assert path.read_text('utf-8').count('\n  {"hidden": "lag"}') == 2


def test_tables_have_the_sums_over_seeds() -> None:
    drawn = [
        {'world': 'foreign', 'variant': '', 'seed': seed, 'counts': {'first': [seed, 24]}}
        for seed in (3, 4, 5, 9)
    ]
    assert write_exams.results(drawn)[2].split(' | ')[1:4] == ['3 to 5, 9', 'file', '21/96']
    assert len(write_exams.draws(drawn)) == 2 + 4

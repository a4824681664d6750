"""Every page: its commands are understood, state their outcome, and its links lead somewhere."""

from __future__ import annotations

import argparse
import re
import shlex
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml
from expectations import Live, Outcome, parse, values_at
from pages import ROOT, blocks_of, pages

from piezo_hysteresis.cli.main import VERBS, load_verb
from piezo_hysteresis.common.registry import NODES
from piezo_sim.cli import build_parser
from studies.papers.pages import PAPERS, by_verbs, paper_page

sys.path.insert(0, str(ROOT / 'test' / 'unit'))
from test_nodes_scenarios import faults

PAGES = sorted([*ROOT.glob('*.md'), *ROOT.glob('docs/**/*.md')])
COMMAND = re.compile(r'(?:python -m|ros2 run) (piezo_hysteresis|piezo_sim)\b((?:(?!-->)[^\n`])*)')
PIEZO = re.compile(r'^(?:\w+=\S+ )*piezo(?= )', re.MULTILINE)  # the installed program

# Blocks that no test runs; their reasons stand in the pages.
NOT_RUN = {
    'docs/axes.md': 2,  # minutes, what loop does
    'docs/tutorials/mirror.md': 1,  # data of the benchmark
    'CONTRIBUTING.md': 1,
    'README.md': 1,
    'docs/batch.md': 1,
    'docs/controllers.md': 3,
    'docs/dashboard.md': 5,
    'docs/detection_limits.md': 2,
    'docs/exams.md': 3,
    'docs/leaderboard.md': 1,
    'docs/hardware.md': 1,
    'docs/records.md': 2,
    'docs/ros2.md': 6,
    'docs/security.md': 5,
    'docs/tutorials/discover.md': 1,
    'docs/validation.md': 5,
}


def commands() -> Iterator[tuple[str, str, str]]:
    for page in PAGES:
        typed = ''.join(b.text for b in blocks_of(page) if b.is_command and b.language != 'python')
        text = page.read_text() + PIEZO.sub('python -m piezo_hysteresis', typed)
        for found in COMMAND.finditer(text.replace('\\\n', ' ')):
            words = re.split('[#|&]', found.group(2))[0].strip()
            if words and '...' not in words and not words.startswith(('VERB', ',', '.', ')', '|')):
                yield page.name, found.group(1), words


ALL = sorted(set(commands()))


def test_there_are_commands_to_try() -> None:
    assert len(ALL) > 10


def parser_of(verb: str) -> argparse.ArgumentParser:
    module = load_verb(verb)
    parser = argparse.ArgumentParser(exit_on_error=False)
    module.configure(parser)
    return parser


@pytest.mark.parametrize(('page', 'program', 'words'), ALL)
def test_a_command_is_understood(page: str, program: str, words: str) -> None:
    arguments = shlex.split(words)
    node = NODES.get(arguments[0], '').startswith(f'{program}.')
    if node and '--ros-args' in arguments:  # the rest is for ROS
        arguments = arguments[: arguments.index('--ros-args')]
    if program == 'piezo_hysteresis' and arguments[0] in VERBS:
        if '--help' in arguments:
            assert parser_of(arguments[0]).format_help()
        else:
            parser_of(arguments[0]).parse_args(arguments[1:])
    elif program == 'piezo_sim' and not arguments[0].startswith('simulator'):
        build_parser().parse_args(arguments)
    else:
        assert node, f'{page}: {program} has no executable {arguments[0]}'


@pytest.mark.parametrize('paper', PAPERS)
def test_the_page_of_a_paper_has_the_present_commands(paper: str) -> None:
    text = (ROOT / 'docs' / 'papers' / paper_page(paper)).read_text(encoding='utf-8')
    assert '\n'.join(by_verbs(paper)) in text


@pytest.mark.parametrize('verb', VERBS)
def test_the_example_of_a_verb_is_understood(verb: str) -> None:
    words = shlex.split(load_verb(verb).EXAMPLE)
    assert words[0] == verb
    parser_of(verb).parse_args(words[1:])


SEPARATOR = re.compile(r'\|[-:| ]*--[-:| ]*\|')


def columns(line: str) -> int:
    """Return the columns of a row of a table; bars in code or behind a backslash are text."""
    return re.sub(r'`[^`]*`|\\\|', '', line).count('|')


@pytest.mark.parametrize('page', PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_tables_have_a_whole_head(page: Path) -> None:
    lines = page.read_text(encoding='utf-8').split('\n')
    heads = [k for k, line in enumerate(lines) if SEPARATOR.search(line)]
    for k in heads:
        assert SEPARATOR.fullmatch(lines[k]), lines[k]
        assert columns(lines[k - 1]) == columns(lines[k]), lines[k - 1]


def anchors(page: Path) -> set[str]:
    """Return the anchors of the headings of a page."""
    heads = re.findall(r'^#+ (.+)$', page.read_text(encoding='utf-8'), re.M)
    return {re.sub(r'[^\w -]', '', head).lower().replace(' ', '-') for head in heads}


@pytest.mark.parametrize('page', PAGES, ids=lambda page: page.name)
def test_links_lead_somewhere(page: Path) -> None:
    for target, anchor in re.findall(r'\]\(([^)#\s]*)(?:#([^)\s]+))?\)', page.read_text()):
        if not target.startswith(('http:', 'https:', 'mailto:')):
            place = page.parent / target if target else page
            assert place.exists(), f'{page.name} links to {target}'
            assert not anchor or anchor in anchors(place), f'{page.name}: {target}#{anchor}'


@pytest.mark.parametrize('page', pages(), ids=lambda page: page.name)
def test_every_command_block_states_its_outcome(page: Path) -> None:
    blocks = blocks_of(page)
    missing = [block.line for block in blocks if block.is_command and not block.expected]
    assert not missing, f'no expectation behind the blocks at lines {missing}'
    for block in blocks:
        kinds = {type(each) for each in block.expected}
        assert len(kinds) < 2 or kinds == {Live}, f'line {block.line}: one kind of outcome only'


def test_how_many_blocks_are_not_run() -> None:
    found = {
        page.relative_to(ROOT).as_posix(): sum(b.not_run is not None for b in blocks_of(page))
        for page in pages()
    }
    assert {page: count for page, count in found.items() if count} == NOT_RUN


@pytest.mark.parametrize(
    'line',
    [
        'not run', 'not run, no', 'file', 'a.json x < one', 'a.json x ~ 1', 'live tracking_rms',
        'live mood > 1', 'looks good', 'output matches', 'a.txt x < 1',
    ],
)  # fmt: skip
def test_what_is_no_expectation_is_refused(line: str) -> None:
    with pytest.raises(ValueError, match=r'form|float'):
        parse(line, 'page.md:1')


def test_an_expectation_can_fail(tmp_path: Path) -> None:
    (tmp_path / 'a.json').write_text('{"runs": [{"rms": 2.0, "name": "x"}, {"rms": 1.0}]}')
    (tmp_path / 'empty').touch()
    for line, holds in {
        'file a.json': True,
        'file empty': False,
        'file b.json': False,
        'a.json runs[*].rms < 2.5': True,
        'a.json runs[*].rms < 1.5': False,
        'a.json runs[-1].rms = 1': True,
        'a.json runs[0].rms > 2': False,
        'a.json runs[2].rms > 0': False,
        'a.json runs[0].name contains x': True,
        'a.json runs[0].name lacks x': False,
        'a.json runs[*].rms only 2.0': False,
        'output matches l+o$': True,
        'output matches bye': False,
    }.items():
        outcome = parse(line)
        assert isinstance(outcome, Outcome)
        if holds:
            outcome.check(tmp_path, 0, 'hello')
        else:
            with pytest.raises(AssertionError):
                outcome.check(tmp_path, 0, 'hello')


def test_a_refusal_is_one_sentence_with_exit_code_2(tmp_path: Path) -> None:
    refused = parse('refused below')
    assert isinstance(refused, Outcome)
    refused.check(tmp_path, 2, 'note: x\nerror: low must be below high\n')
    for code, output in ((0, ''), (2, 'usage: x'), (2, 'error: above'), (1, 'error: below')):
        with pytest.raises(AssertionError):
            refused.check(tmp_path, code, output)


def test_values_at_a_path() -> None:
    content = {'a': [{'b': [1, 2]}, {'b': [3]}]}
    assert values_at(content, 'a[*].b[*]') == [1, 2, 3]
    assert values_at(content, 'a[-1].b[0]') == [3]


def test_every_tutorial_is_listed_and_followed() -> None:
    listed = (ROOT / 'docs' / 'tutorials' / 'README.md').read_text()
    for page in ROOT.glob('docs/tutorials/*.md'):
        if page.name != 'README.md':
            assert f']({page.name})' in listed
            assert any(block.expected and not block.not_run for block in blocks_of(page))


PARAMETER_FILES = [
    (page, block)
    for page in PAGES
    for block in blocks_of(page)
    if block.language == 'yaml' and 'ros__parameters' in block.text
]


@pytest.mark.parametrize(
    ('page', 'block'), PARAMETER_FILES, ids=lambda each: getattr(each, 'name', '')
)
def test_parameter_files_in_pages_are_taken_by_the_nodes(page: Path, block: Any) -> None:
    assert faults(yaml.safe_load(block.text)) == []


def test_there_are_parameter_files_and_all_yaml_can_be_read() -> None:
    assert len(PARAMETER_FILES) >= 2
    for page in PAGES:
        for block in blocks_of(page):
            if block.language == 'yaml':
                assert yaml.safe_load(block.text) is not None, page.name

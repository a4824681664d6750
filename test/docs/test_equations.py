"""The map of the equations is complete, and statements of the page are in the papers."""

from __future__ import annotations

import argparse
import importlib
import io
import re
import sys
from contextlib import redirect_stdout
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
TEXTS = ROOT.parent / 'shared' / 'papers'
sys.path.insert(0, str(ROOT / 'tools'))

import write_equations  # noqa: E402
from equations import EQUATIONS  # noqa: E402

from piezo_hysteresis.blocks import BLOCKS  # noqa: E402
from piezo_hysteresis.cli.main import VERBS, load_verb  # noqa: E402
from piezo_hysteresis.identification.methods import METHODS  # noqa: E402
from piezo_hysteresis.models import NAMES  # noqa: E402
from piezo_sim.cli import build_parser  # noqa: E402
from studies.papers.script import main as script_main  # noqa: E402

# How many equations each paper numbers; of Fang 2019 the text keeps one number.
NUMBERED = {'Fujii 2018': 25, 'Tatebatake 2017': 18, 'Zhou 2021': 9, 'Xiao 2014': 5}
FILES = dict(zip(EQUATIONS, ('000', '001', '002', '003', '004'), strict=True))


def test_every_numbered_equation_is_listed() -> None:
    for paper, count in NUMBERED.items():
        assert list(EQUATIONS[paper]) == [str(k) for k in range(1, count + 1)]
    assert '9' in EQUATIONS['Fang 2019']


def test_every_equation_has_a_place_that_exists() -> None:
    places = write_equations.places()
    for paper, equations in EQUATIONS.items():
        for label in equations:
            assert places.get((paper, label)), f'{paper} ({label}) is tagged in no docstring'
    for place in {place for each in places.values() for place in each}:
        name, _, inside = place.partition(':')
        found = importlib.import_module(name)
        for part in filter(None, inside.split('.')):
            found = getattr(found, part)


def test_a_range_of_equations_is_written_out() -> None:
    text = 'as Fujii 2018 (8)-(10), (12)\n    and Zhou 2021 (3)'
    assert list(write_equations.tags(text)) == [
        ('Fujii 2018', '8'), ('Fujii 2018', '9'), ('Fujii 2018', '10'), ('Fujii 2018', '12'),
        ('Zhou 2021', '3'),
    ]  # fmt: skip


def options_of(words: list[str]) -> set[str]:
    """Return the options that a command of the page may have."""
    shown = io.StringIO()
    if words[0] == 'python':
        assert (ROOT / words[1]).is_file()
        with redirect_stdout(shown), pytest.raises(SystemExit):
            script_main('', (), ['--help'])
        text = shown.getvalue()
    elif words[0] == 'piezo_sim':
        with redirect_stdout(shown), pytest.raises(SystemExit):
            build_parser().parse_args([words[1], '--help'])
        text = shown.getvalue()
    else:
        assert words[0] in VERBS
        parser = argparse.ArgumentParser()
        load_verb(words[0]).configure(parser)
        text = parser.format_help()
    return set(re.findall(r'--[a-z][a-z0-9-]*', text))


@pytest.mark.parametrize('paper', EQUATIONS)
def test_the_commands_are_understood(paper: str) -> None:
    for each in EQUATIONS[paper].values():
        words = each.command.split()
        assert {word for word in words if word.startswith('--')} <= options_of(words)
        for option, known in (('--model', (*NAMES, *BLOCKS)), ('--method', (*METHODS, 'arx'))):
            if option in words and '...' not in words:
                assert words[words.index(option) + 1] in known


def test_the_page_is_that_of_the_tags() -> None:
    assert write_equations.PAGE.read_text() == write_equations.page()


# --- what the page of the papers states ---------------------------------------------------------


def plain(text: str) -> str:
    """Return a text as one line, signs and spaces alike."""
    text = text.replace('−', '-').replace('μ', 'u').replace('µ', 'u')
    text = re.sub(r'(?<=\d):(?=\d)', '.', text)  # a point that was read as a colon
    text = re.sub(r'(\.\d{4})(?=\d)', r'\1 ', text)  # columns of a table that run together
    return re.sub(r'(?<=\d) (?=\d{3}(?!\d))', '', ' '.join(text.split()))


def text_of(paper: str) -> str:
    """Return the plain text of a paper."""
    (path,) = TEXTS.glob(f'{FILES[paper]}_*.txt')
    return plain(path.read_text(errors='replace'))


def stated(paper: str) -> list[str]:
    """Return what the page says that a paper states."""
    page = ROOT / 'docs' / 'papers' / f'{paper.lower().replace(" ", "")}.md'
    return re.findall(r'^- Paper: (.+)$', page.read_text(), re.MULTILINE)


needs_texts = pytest.mark.skipif(not TEXTS.is_dir(), reason='needs the texts of the papers')


# What stands for a paper that shows a figure without words, or whose text has lost a table.
WITHOUT_WORDS = ('shown', 'missing from the text')


@pytest.mark.parametrize('paper', EQUATIONS)
def test_what_a_paper_states_is_quoted_or_a_number(paper: str) -> None:
    for statement in stated(paper):
        if not statement.startswith(WITHOUT_WORDS):
            assert re.search(r'"[^"]{5,}"|\d', statement), statement


@needs_texts
@pytest.mark.parametrize('paper', EQUATIONS)
def test_quotations_are_in_the_paper(paper: str) -> None:
    text = text_of(paper)
    found = [each for statement in stated(paper) for each in re.findall(r'"([^"]+)"', statement)]
    assert found
    for quotation in found:
        assert plain(quotation) in text, f'{paper}: not in its text: {quotation}'


@needs_texts
@pytest.mark.parametrize('paper', EQUATIONS)
def test_numbers_attributed_to_a_paper_are_in_its_text(paper: str) -> None:
    text = text_of(paper)
    printed = {float(each) for each in re.findall(r'\d+(?:\.\d+)?', text)}
    powers = re.findall(r'(\d+(?:\.\d+)?)\s*\\?t?imes\s*10\^\{?(-?\d+)', text)
    printed |= {float(f'{factor}e{power}') for factor, power in powers}
    for statement in stated(paper):
        for number in re.findall(r'(?<![\w.^])\d+(?:\.\d+)?(?:e-?\d+)?(?![\w.]*\d)', statement):
            value = float(number)
            digits = len(number.partition('e')[0].replace('.', '').lstrip('0'))
            near = any(value == float(f'{each:.{digits}g}') for each in printed)
            assert near, f'{paper}: {number} of "{statement}" is not in its text'

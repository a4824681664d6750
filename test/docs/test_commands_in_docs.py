"""Every command that the documents tell a reader to type is one that the programs understand."""

from __future__ import annotations

import argparse
import re
import shlex
from collections.abc import Iterator
from pathlib import Path

import pytest

from piezo_hysteresis.cli.main import VERBS, load_verb
from piezo_sim.cli import build_parser

ROOT = Path(__file__).parents[2]
PAGES = sorted([*ROOT.glob('*.md'), *ROOT.glob('docs/**/*.md')])
COMMAND = re.compile(r'(?:python -m|ros2 run) (piezo_hysteresis|piezo_sim)\b([^\n`]*)')


def commands() -> Iterator[tuple[str, str, str]]:
    for page in PAGES:
        text = page.read_text().replace('\\\n', ' ')
        for found in COMMAND.finditer(text):
            words = re.split('[#|]', found.group(2))[0].strip()
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
    node = any(ROOT.glob(f'src/{program}/{program}/nodes/**/{arguments[0]}.py'))
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


@pytest.mark.parametrize('page', PAGES, ids=lambda page: page.name)
def test_links_lead_somewhere(page: Path) -> None:
    for target in re.findall(r'\]\(([^)#\s]+)', page.read_text()):
        if not target.startswith(('http:', 'https:', 'mailto:')):
            assert (page.parent / target).exists(), f'{page.name} links to {target}'

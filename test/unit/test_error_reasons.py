"""Messages name a reason of the system in words: no errno, no path for a second time."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

from piezo_hysteresis.common.parameter_table import ParameterSpec
from piezo_hysteresis.common.wording import OneLineParser, reason_of

SOURCES = sorted(Path(__file__).parents[2].glob('src/*/piezo_*/**/*.py'))


def test_a_reason_has_neither_number_nor_path(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError) as found:
        (tmp_path / 'gone').read_text()
    assert reason_of(found.value) == 'the path does not exist'
    assert reason_of(ValueError('two\n  lines')) == 'two lines'


def caught(handler: ast.ExceptHandler) -> set[str]:
    kinds = handler.type.elts if isinstance(handler.type, ast.Tuple) else [handler.type]
    return {kind.id for kind in kinds if isinstance(kind, ast.Name)}


def shows_errno(handler: ast.ExceptHandler) -> bool:
    """Return whether the text of an OSError is shown as it is."""
    text = ast.unparse(handler)
    return f'str({handler.name})' in text or f'{{{handler.name}}}' in text or 'strerror' in text


@pytest.mark.component
def test_no_handler_shows_an_error_of_the_system_as_it_is() -> None:
    of_system = {'OSError', 'FileNotFoundError', 'PermissionError', 'ConnectionError'}
    found = [
        f'{path.name}:{node.lineno}'
        for path in SOURCES
        for node in ast.walk(ast.parse(path.read_text(encoding='utf-8')))
        if isinstance(node, ast.ExceptHandler) and caught(node) & of_system and shows_errno(node)
    ]
    assert not found


def test_an_option_of_a_verb_is_suggested(capsys: pytest.CaptureFixture[str]) -> None:
    parser = OneLineParser(prog='x', exit_on_error=False)
    verbs = parser.add_subparsers(metavar='VERB')
    verbs.add_parser('sweep').add_argument('--waveform')
    with pytest.raises(SystemExit):
        parser.parse_args(['sweep', '--wavefrm', 'sine'])
    assert '--wavefrm is not understood (did you mean --waveform?)' in capsys.readouterr().err


def test_a_choice_of_a_parameter_is_suggested() -> None:
    spec = ParameterSpec('waveform', 'sine', 'Shape.', choices=('sine', 'chirp'))
    assert spec.judge('chrp').endswith("got 'chrp' (did you mean chirp?)")

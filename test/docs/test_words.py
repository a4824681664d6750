"""The pages use the terms of the field; words of a private dialect fail, with what to write."""

from __future__ import annotations

import ast
import io
import re
import sys
import tokenize
from collections.abc import Iterator
from pathlib import Path

import pytest
from pages import ROOT

sys.path.insert(0, str(ROOT / 'tools'))
from readability import prose

# Each pattern with what a page says instead. Patterns leave correct uses alone.
DIALECT = {
    r'told|tells?': 'report, state, distinguish, show',
    r'said': 'stated, reported',
    r'whoever|whom': 'who, the client, the operator',
    r'nobody|somebody': 'no user, an operator; passive voice',
    r'(?:comes?|came|coming) first': 'is ranked first',
    r'news': 'change, new deviation',
    r'forg[eo]ts?|forgotten': 'omit, discard (a forgetting factor is correct)',
    r'besides?(?! each other)': 'next to, in addition to, with',
    r'what (?:is|was) left': 'the residual, the remaining error',
    r'begun': 'started',
    r'believed?': 'accept, estimate',
    r'for ever': 'indefinitely',
    r'h(?:ears?|eard)': 'receive, subscribe to',
    r'hand(?:s|ed)? out': 'return',
    r'mended?': 'corrected',
    r'hangs? together': 'are correlated',
    r'by lot': 'at random',
    r'makes? good|made good': 'compensate',
    r'prove[sd]? (?:itself|themselves)': 'is significant',
    r'floors? away': 'times the noise floor',
    r'stands? (?:beside|by itself)': 'runs in parallel with, is separate',
    r'fell silent|falls? silent': 'stops publishing',
    r'as fast as (?:it|they) can': 'at full speed',
    r'in the place of': 'instead of',
    r'tak(?:es?|en) off': 'suppress, subtract',
    r'outsiders?': 'effects outside the library',
    r'(?:is|are|was|were|be) judged': 'is evaluated',
    r'go(?:es)? on': 'continue',
    r'gives? up|given up': 'abort, terminate',
    r'meanwhile': 'during that time',
    r'all the same': 'nevertheless',
    r'to be trusted': 'reliable',
}
WORDS = {re.compile(rf'\b(?:{bad})\b', re.IGNORECASE): good for bad, good in DIALECT.items()}

# Of the same dialect, in names of functions, classes, arguments, attributes and variables.
NAMES = re.compile(
    '(any|every|no|some)body|begun|believed|crew|desk|doubt|ear|forgets?|forgotten|hears?|heard|'
    'herald|hindsight|hopeful|impatient|lacks|mended|news|patience|raced|said|says|spoken|'
    'tell(s|er|ing)?|told|who(ever|m)|wish(ed|es)?|worthy'
)

# Written from docstrings and --help.
GENERATED = ('docs/reference/',)
# Words of a page with its tables, lists and code; nodes and effects are looked up one by one.
LONGEST_PAGE = 2500
REFERENCE = ('docs/nodes.md', 'docs/effects.md')


def pages() -> list[str]:
    found = [*ROOT.glob('*.md'), *ROOT.glob('docs/**/*.md')]
    names = sorted(page.relative_to(ROOT).as_posix() for page in found)
    return [name for name in names if not name.startswith(GENERATED)]


def dialect(text: str) -> list[str]:
    """Return the dialect words of a page, each with its neighbours and the standard term."""
    tables = re.sub('`[^`]*`', 'code', ' '.join(re.findall(r'^\|.*$', text, re.M)))
    running = ' '.join(prose(text).split()) + ' ' + tables
    return [
        f'...{running[max(0, hit.start() - 30) : hit.end() + 20]}...: write {good}'
        for bad, good in WORDS.items()
        for hit in bad.finditer(running)
    ]


@pytest.mark.parametrize('page', pages())
def test_a_page_uses_the_terms_of_the_field(page: str) -> None:
    found = dialect((ROOT / page).read_text(encoding='utf-8'))
    assert not found, '\n'.join(found)


def length(text: str) -> int:
    """Return the words of a page that a reader sees: all but comments."""
    return len(re.sub('<!--.*?-->', '', text, flags=re.DOTALL).split())


@pytest.mark.parametrize('page', sorted({*pages()} - {*REFERENCE}))
def test_a_page_is_read_in_one_go(page: str) -> None:
    words = length((ROOT / page).read_text(encoding='utf-8'))
    assert words <= LONGEST_PAGE, f'{words} words: divide the page'


def test_the_length_counts_tables_and_code() -> None:
    assert length('# One\n\n| two | three |\n<!-- not\nthis -->\n    four five\n') == 9


@pytest.mark.parametrize(
    ('text', 'count'),
    [
        ('It is told that nobody came first.', 3),
        ('A forgetting factor, two plots beside each other, the foretold.', 0),
        ('Run `told` now.\n\n    told nobody\n\n<!-- told -->', 0),
        ('| effect | told |\n', 1),
    ],
)
def test_the_list_finds_dialect_and_nothing_else(text: str, count: int) -> None:
    assert len(dialect(text)) == count


def texts(path: Path) -> Iterator[str]:
    """Yield the docstrings and comments of a file; code in them is left out."""
    source = path.read_text(encoding='utf-8')
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef):
            yield ast.get_docstring(node) or ''
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        if token.type == tokenize.COMMENT:
            yield token.string


def test_docstrings_and_comments_use_the_terms_of_the_field() -> None:
    found = []
    for folder in ('src', 'studies', 'tools', 'bench'):
        for path in (ROOT / folder).rglob('*.py'):
            for text in texts(path):
                plain = re.sub(r'`+[^`]*`+', 'code', text)
                found += [
                    f'{path.relative_to(ROOT)}: {hit.group()}: write {good}'
                    for bad, good in WORDS.items()
                    for hit in bad.finditer(plain)
                ]
    assert not found, '\n'.join(found)


def defined(tree: ast.Module) -> Iterator[str]:
    """Yield the names that a module defines."""
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            yield node.name
        elif isinstance(node, ast.arg):
            yield node.arg
        elif isinstance(node, ast.Name | ast.Attribute) and isinstance(node.ctx, ast.Store):
            yield node.id if isinstance(node, ast.Name) else node.attr


def test_names_of_the_source_use_the_terms_of_the_field() -> None:
    found = {}
    for path in (ROOT / 'src').rglob('*.py'):
        for name in (path.stem, *defined(ast.parse(path.read_text(encoding='utf-8')))):
            words = re.findall('[A-Z]?[a-z]+|[A-Z]+', name)
            if any(NAMES.fullmatch(each.lower()) for each in words):
                found[name] = path.relative_to(ROOT).as_posix()
    assert not found

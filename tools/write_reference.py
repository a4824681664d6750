"""Write docs/reference/*.md from docstrings and from what the verbs say of themselves.

Called by ``python tools/write_docs.py``, which also checks that the pages are up to date.
"""

from __future__ import annotations

import argparse
import importlib
import inspect
import os
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

FOLDER = Path(__file__).resolve().parents[1] / 'docs' / 'reference'

# Page: its sentence, and the modules whose public names it lists. A package lists ``__all__``.
PAGES = {
    'records': ('Data in and out. In words: [records](../records.md).', ('records',)),
    'models': ('Chains of blocks. In words: [models](../models.md).', ('models',)),
    'identification': (
        'Parameters from records. In words: [identification](../identification.md).',
        ('identification', 'identification.errors'),
    ),
    'compensation': (
        'Voltages from a reference. In words: [compensation](../compensation.md).',
        (
            *(
                f'compensation.{name}'
                for name in (
                    'base', 'inverses.choice', 'loop', 'model_plant', 'harmonics.attenuation',
                    'harmonics.settings', 'feedback.settings', 'feedback.pid',
                    'feedback.fuzzy_pid', 'feedback.hinf', 'limiter',
                )
            ),
            'interface.compensate_runs',
        ),
    ),
    'discovery': (
        'What a model misses. In words: [discovery](../discovery.md).',
        ('discovery', 'discovery.choice.choose'),
    ),
    'batch': ('Many data sets at once. In words: [batch](../batch.md).', ('batch',)),
    'waveforms': ('Signals with derivatives.', ('waveforms',)),
}  # fmt: skip

NOTE = 'Written by `python tools/write_docs.py` from the docstrings; a test holds it to them.'


def reference_pages() -> dict[Path, str]:
    """Return the text of every page by path."""
    pages = {FOLDER / f'{name}.md': _page(name, *about) for name, about in PAGES.items()}
    pages[FOLDER / 'cli.md'] = _commands()
    pages[FOLDER / 'policy.md'] = _policy()
    links = '\n'.join(f'- [{name}]({name}.md): {about[0]}' for name, about in PAGES.items())
    pages[FOLDER / 'README.md'] = (
        f'# Reference\n\n{NOTE}\n\n- [cli](cli.md): every verb with its words.\n{links}\n'
        '- [nodes](../nodes.md): every node with its topics and parameters.\n'
        '- [policy](policy.md): every number by which discovery decides.\n'
    )
    return pages


def _policy() -> str:
    from piezo_hysteresis.discovery.choice import policy as choice
    from piezo_hysteresis.discovery.selection import policy

    example = (
        'python -m piezo_hysteresis discover sweep --baseline classical --out found '
        '--policy min_share=0.5'
    )
    return '\n'.join(
        (
            '# What decides',
            '',
            _prose(inspect.getdoc(policy) or '').strip(),
            '',
            'Others are given to `discover` with `--policy NAME=VALUE`. Where a number differs',
            'for a baseline that is held, its value there follows.',
            '',
            f'    {example}',
            '',
            *_numbers(policy.rows()),
            '',
            'A model that is chosen to predict (`demo --data`) asks these besides:',
            '',
            *_numbers(policy.rows(choice.CHOICE, choice.CHOICE)),
            '',
            NOTE,
            '',
        )
    )


def _numbers(rows: list[tuple[str, str, str, str, str]]) -> list[str]:
    return [
        '| name | value | unit | what it means, and where it is from |',
        '|---|---|---|---|',
        *(
            '| ' + ' | '.join((f'`{name}`', value, unit, f'{means} *{source}*')) + ' |'
            for name, value, unit, means, source in rows
        ),
    ]


def _page(title: str, sentence: str, modules: tuple[str, ...]) -> str:
    parts = [f'# {title}\n\n{sentence}\n\n{NOTE}']
    for name in modules:
        module = importlib.import_module(f'piezo_hysteresis.{name}')
        parts.append(f'## `{module.__name__}`\n\n{_prose(inspect.getdoc(module) or "")}')
        parts += [_entry(key, value) for key, value in _public(module)]
    return '\n\n'.join(part.rstrip() for part in parts) + '\n'


def _public(module: Any) -> Iterator[tuple[str, Any]]:
    names = getattr(module, '__all__', None)
    for name in sorted(names or vars(module), key=str.lower):
        value = getattr(module, name)
        if not (inspect.isclass(value) or inspect.isfunction(value)):
            continue
        if names or (not name.startswith('_') and value.__module__ == module.__name__):
            yield name, value


def _entry(name: str, value: Any) -> str:
    lines = [f'### {name}', '', '```text', _signature(name, value), '```', '']
    lines.append(_prose(inspect.getdoc(value) or ''))
    if inspect.isclass(value):
        lines += ['', *_members(value)]
    return '\n'.join(lines)


def _members(owner: type) -> list[str]:
    rows = []
    for name, value in vars(owner).items():
        inner = value.fget if isinstance(value, property) else value
        inner = inner.__func__ if isinstance(inner, classmethod | staticmethod) else inner
        if name.startswith('_') or not inspect.isfunction(inner):
            continue
        words = f'`{name}`' if isinstance(value, property) else f'`{name}({_arguments(inner)})`'
        rows.append(f'- {words}: {(inspect.getdoc(inner) or "").split(chr(10))[0]}')
    return rows


def _signature(name: str, value: Any) -> str:
    if getattr(value, '_is_protocol', False):
        return f'{name} (protocol: anything that has these)'
    try:
        parameters = list(inspect.signature(value).parameters.values())
    except (TypeError, ValueError):
        return name
    words = [_parameter(p) for p in parameters if p.name != 'self']
    for k, p in enumerate(parameters):
        if p.kind is p.KEYWORD_ONLY:
            words.insert(k, '*')
            break
    line = f'{name}({", ".join(words)})'
    if len(line) <= 96:
        return line
    return f'{name}(\n' + ''.join(f'    {word},\n' for word in words) + ')'


def _arguments(function: Any) -> str:
    return ', '.join(p for p in inspect.signature(function).parameters if p not in ('self', 'cls'))


def _parameter(p: inspect.Parameter) -> str:
    star = '*' if p.kind is p.VAR_POSITIONAL else '**' if p.kind is p.VAR_KEYWORD else ''
    kind = '' if p.annotation is p.empty else f': {_annotation(p.annotation)}'
    default = '' if p.default is p.empty else f' = {_default(p.default)}'
    return f'{star}{p.name}{kind}{default}'


def _annotation(kind: Any) -> str:
    kind = getattr(kind, '__forward_arg__', kind)
    return kind if isinstance(kind, str) else getattr(kind, '__name__', str(kind))


def _default(value: Any) -> str:
    if inspect.isfunction(value):
        return '...' if value.__name__ == '<lambda>' else value.__name__
    return re.sub(r' at 0x[0-9a-f]+', '', repr(value))


def _prose(doc: str) -> str:
    """Return a numpy docstring as Markdown: sections in bold, entries as lists."""
    lines, out, k, listing = doc.splitlines(), [], 0, False
    while k < len(lines):
        line = lines[k]
        if k + 1 < len(lines) and re.fullmatch(r'-{3,}', lines[k + 1].strip()):
            out += ['', f'**{line.strip()}**', '']
            listing, k = True, k + 2
            continue
        if listing and line.strip():
            out.append(f'  {line.strip()}' if line.startswith('    ') else f'- {_named(line)}')
        else:
            out.append(line)
        k += 1
    return re.sub(r'\n{3,}', '\n\n', '\n'.join(out)).strip()


def _named(line: str) -> str:
    name, colon, kind = line.partition(' : ')
    return f'`{name}` ({kind})' if colon else f'`{name}`'


def _commands() -> str:
    from piezo_hysteresis.cli.main import VERBS, load_verb

    os.environ['COLUMNS'] = '92'  # argparse wraps to it
    head = (
        '# Command line\n\n`python -m piezo_hysteresis VERB`, or with ROS 2 installed '
        '`ros2 run piezo_hysteresis VERB`. An error is one line that says what to do, exit code '
        '2.\n\nA folder of results belongs to the verb that filled it: run again, it replaces '
        'its own files. Any other folder that is not empty is refused before anything is '
        'computed; `--overwrite` writes there all the same. Whose a folder is says the hidden '
        'file `.results.json` in it.\n\n'
        f'{NOTE.replace("docstrings", "programs")}'
    )
    parts = [head]
    for verb in VERBS:
        module = load_verb(verb)
        parser = argparse.ArgumentParser(
            prog=f'piezo_hysteresis {verb}', description=module.__doc__ or module.HELP
        )
        module.configure(parser)
        parts += _help(verb, parser)
    from piezo_sim.cli import build_parser

    for name, parser in _below(build_parser()).items():
        parts += _help(f'piezo_sim {name}', parser)
    return '\n\n'.join(parts) + '\n'


def _help(title: str, parser: argparse.ArgumentParser) -> list[str]:
    """Return the sections of a verb and of the verbs below it."""
    parts = [f'## {title}\n\n```text\n{parser.format_help().rstrip()}\n```']
    for name, below in _below(parser).items():
        parts += _help(f'{title} {name}', below)
    return parts


def _below(parser: argparse.ArgumentParser) -> dict[str, argparse.ArgumentParser]:
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            return dict(action.choices)
    return {}

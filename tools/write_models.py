"""Write tables and sections of blocks and effects from their traits.

Called by ``python tools/write_docs.py``. It replaces the table of effects in docs/models.md,
writes docs/reference/parameters.md, and adds a section to docs/effects.md for each effect that has
none; later edits of a section are manual.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from pathlib import Path

from piezo_hysteresis.blocks import BLOCKS, Block, Effect, Parameter
from piezo_hysteresis.models import EFFECT_NAMES, described

DOCS = Path(__file__).resolve().parents[1] / 'docs'
MODELS = DOCS / 'models.md'
EFFECTS = DOCS / 'effects.md'
PARAMETERS = DOCS / 'reference' / 'parameters.md'
PARAMETERS_INTRO = """# Parameters of the blocks

Bounds are physical limits; defaults are for 1 V and 130 µm. The play bank has `w1` to `w9` like
`w1` below (thresholds 0.1 to 0.9 of `pi_range`), the nonlocal memory `memory1` to `memory9` (0.1
to 0.9 of `memory_range`) or `fine_memory1` to `fine_memory39` (1/40 to 39/40 of
`fine_memory_range`), Preisach `mu_0_0` to `mu_7_7`, and the selector every `inverse_` parameter at
ten knots (`inverse_gain_at1` ...). `python tools/write_docs.py` writes this page.
"""

_BLOCKS_HEAD = (
    '| block | parameter | unit | default | bounds | meaning |\n|---|---|---|---|---|---|'
)
_EFFECTS_HEAD = '| effect | variants |\n|---|---|'
_SERIES = 5  # so many parameters that differ by a number alone are one row


def model_pages() -> dict[Path, str]:
    """Return the text of every page by path."""
    page = MODELS.read_text(encoding='utf-8')
    page = _replaced(page, _EFFECTS_HEAD, _effect_rows())
    table = '\n'.join([PARAMETERS_INTRO, _BLOCKS_HEAD, *_block_rows(), ''])
    return {MODELS: page, PARAMETERS: table, EFFECTS: _effects()}


def sections() -> dict[str, str]:
    """Return the text of each section of docs/effects.md by the name of its effect."""
    _, *parts = re.split(r'^## (\w+)\n', EFFECTS.read_text(encoding='utf-8'), flags=re.M)
    return dict(zip(parts[::2], parts[1::2], strict=True))


def _effects() -> str:
    head = re.split(r'^## ', EFFECTS.read_text(encoding='utf-8'), maxsplit=1, flags=re.M)[0]
    found = {name: _new_section(name) for name in EFFECT_NAMES} | sections()
    listed = ', '.join(f'[{name}](#{name})' for name in sorted(found))
    head = re.split(r'^\*\*Sections\*\*', head, maxsplit=1, flags=re.M)[0].rstrip()
    head = f'{head}\n\n**Sections**: {listed}.\n\n'
    return head + '\n'.join(f'## {name}\n{found[name].rstrip()}\n' for name in sorted(found))


def _replaced(page: str, head: str, rows: Iterable[str]) -> str:
    """Return `page` with the rows of the table under `head` replaced."""
    begin = page.index(head) + len(head)
    end = re.compile(r'\n(?!\|)').search(page, begin)
    tail = page[end.start() :] if end else '\n'
    return page[:begin] + ''.join(f'\n{row}' for row in rows) + tail


def _block_rows() -> Iterator[str]:
    for name in sorted(BLOCKS):
        for q in shown_parameters(BLOCKS[name]):
            yield (
                f'| `{name}` | `{q.name}` | {q.unit} | {q.default:g} | {q.low:g} .. {q.high:g} | '
                f'{q.description} |'
            )


def shown_parameters(block: Block) -> Iterator[Parameter]:
    """Return the parameters of a block, of a long numbered series only the first one."""
    kinds = [_kind(q) for q in block.parameters]
    for place, (q, kind) in enumerate(zip(block.parameters, kinds, strict=True)):
        if kinds.count(kind) < _SERIES or kinds.index(kind) == place:
            yield q


def _kind(parameter: Parameter) -> tuple[str, str]:
    text = re.sub(r'[\d.]+', '#', f'{parameter.name} {parameter.description}')
    return text, parameter.unit


def _effect_rows() -> Iterator[str]:
    for name in EFFECT_NAMES:
        variants = ', '.join(f'`{effect.variant}`' for effect in described(name))
        yield f'| [{name}](effects.md#{name}) | {variants} |'


def _new_section(name: str) -> str:
    """Return a section for an effect that has none, from its file."""
    effects = described(name)
    causes = _by_variant((e.variant, e.physics) for e in effects)
    lines = ['', f'**Physical cause.** {causes}', '']
    lines += ['**Signature.** See the picture: a model without and with the effect.', '']
    lines += [f'![A model without and with {name}](pictures/effects/{name}.png)', '']
    others = dict.fromkeys(other for effect in effects for other in effect.mistaken_for)
    links = ', '.join(f'[{other}](#{other})' for other in others)
    lines += [f'**Similar effects.** {links or "None"}.', '']
    lines += [
        '**Distinguishing experiment.** '
        + _by_variant((e.variant, e.experiment) for e in effects),
        '',
    ]
    lines += ['**Model blocks.**', '', '| variant | block | neutral |', '|---|---|---|']
    lines += [_variant(effect) for effect in effects]
    return '\n'.join(lines) + '\n'


def _by_variant(pairs: Iterable[tuple[str, str]]) -> str:
    """Return one sentence, or a list with the variants of each sentence."""
    variants: dict[str, list[str]] = {}
    for variant, sentence in pairs:
        variants.setdefault(sentence, []).append(f'`{variant}`')
    if len(variants) == 1:
        return next(iter(variants))
    rows = (f'- {", ".join(names)}: {sentence}' for sentence, names in variants.items())
    return 'By variant:\n\n' + '\n'.join(rows)


def _variant(effect: Effect) -> str:
    neutral = ', '.join(f'`{name}` = {value:g}' for name, value in effect.neutral.items())
    block = f'`{effect.block.name}`' if effect.block is not None else 'none'
    return f'| `{effect.variant}` | {block} | {neutral} |'

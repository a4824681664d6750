"""Discovery test: effects in actuators from the literature (Maxwell, Duhem, LuGre, leakage).

    python studies/discovery_foreign.py --seed 21 --page docs/discovery_foreign.md

As `studies/discovery_hidden.py`, but the records come from `studies/foreign_worlds.py`. A baseline
that cannot be exact there is identified on six untouched records; effects hide in six others.
"""

from __future__ import annotations

import argparse
import math
import sys
import tempfile
from pathlib import Path

import numpy as np

if not __package__:
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from bench.quick import parsed
from piezo_hysteresis.records import write_bag
from studies.discovery_hidden import HIDDEN, Case, Row, Search, examined, page
from studies.foreign_worlds import WORLDS, recorded

FITTED = tuple((a, f) for f in (1.0, 7.0, 23.0) for a in (0.5, 1.0))
JUDGED = tuple((a, f) for f in (2.0, 5.0, 17.0) for a in (0.6, 0.9))
SECONDS = 5.0
#: The model that a lab would take for each world.
BASELINES = {
    'elastoslides': 'bouc_wen_mode',
    'Duhem': 'bouc_wen_mode',
    'two modes, friction': 'linear_mode',
    'leaking charge': 'bouc_wen_mode',
}
HEAD = (
    '# Discovery test: actuators from the literature',
    '',
    'Four actuators from textbook equations, integrated in continuous time by SciPy, share',
    'nothing with the models (`studies/foreign_worlds.py`): elastoslides (Goldfarb and',
    'Celanovic 1997), Duhem (Coleman and Hodgson 1986), two modes with friction (Canudas de',
    'Wit 1995), and leaking charge. A baseline that cannot be exact is identified on six',
    'sines. An effect of random size is added to six others; `discover` gets these and the',
    '`model.yaml`. The search is frozen before any of these records exists.',
    '[validation.md](validation.md) has the summary, [draws.md](draws.md) every draw.',
    '',
    '    python studies/discovery_foreign.py --seed {seed} --page docs/discovery_foreign.md',
)
SIZES = (
    'Sizes are 0.25 to 1. Size 1 is a delay or lag of 4 ms, a sensor nonlinearity of 2.5 % at',
    'the ends, a tone of 1.5 % of the stroke, a drift of 15 % of the stroke and a gain loss of',
    '16 % in 5 s. Noise is 0.2 % of the stroke.',
)


def records_into(folder: Path, seed: int, worlds: int, seconds: float) -> list[Case]:
    """Write the records of the first worlds as bags and return the cases that name them."""
    cases = []
    for place, (name, world) in enumerate(list(WORLDS.items())[:worlds]):
        random = np.random.default_rng([seed, place, 99])
        files = (f'{place}_fitted', f'{place}_judged')
        for file, drives in zip(files, (FITTED, JUDGED), strict=True):
            write_bag(folder / file, recorded(world, drives, seconds, random))
        cases.append(Case(name, files[0], np.inf, files[1:], (BASELINES[name],), seconds, 4e-3))
    return cases


def main() -> None:
    """Examine, print and write the page."""
    parser = argparse.ArgumentParser(description=__doc__.split('\n')[0])
    parser.add_argument('--seed', type=int, default=0)
    parser.add_argument('--workers', type=int, default=1)
    parser.add_argument('--page', type=Path)
    parser.add_argument('--worlds', type=int, default=len(WORLDS), help='so many of them')
    parser.add_argument('--effects', type=int, default=len(HIDDEN), help='so many, and none')
    parser.add_argument('--seconds', type=float, default=SECONDS, help='of every record')
    parser.add_argument('--time-limit', type=float, default=math.inf, help='of each search [s]')
    arguments = parsed(parser, worlds=1, effects=2, seconds=1.0, time_limit=2.0)
    rows: list[Row] = []
    with tempfile.TemporaryDirectory() as made:
        given = arguments.seed, arguments.worlds, arguments.seconds
        how = Search(arguments.workers, arguments.time_limit, arguments.effects)
        for place, case in enumerate(records_into(Path(made), *given)):
            seed = arguments.seed, place
            rows += examined(case, case.baselines[0], Path(made), seed, how)
    text = page(rows, arguments.seed, HEAD, SIZES)
    print(text)
    if arguments.page:
        arguments.page.write_text(text, encoding='utf-8')


if __name__ == '__main__':
    main()

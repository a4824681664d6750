"""Studies of the discovery: what hides in a world is to be found from records of it.

    python studies/study.py WORLD --seed N

`python studies/study.py WORLD --help` shows the protocol and the options of a world.
"""

from __future__ import annotations

import argparse
import importlib
import math
import sys
from collections.abc import Sequence
from pathlib import Path

if not __package__:
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from bench.quick import parsed
from studies.exams import Exam

WORLDS = {
    'simulated': 'random actuators of piezo_sim, effects of random size',
    'lottery': 'an independent simulation with random recording conditions',
    'foreign': 'effects in actuators from the literature',
    'hidden': 'effects added to measured records of an actuator',
    'observer': 'what an ideal observer would name of hidden curves and gains',
    'leaderboard': 'measured records: this suite and its peers in free run',
    'investigate': 'the same as simulated, but the experiments are chosen',
    'investigate_foreign': 'the same as foreign, but the experiments are chosen',
    'choice': 'a model chosen to predict, against what the discovery ends with',
    'detection_limits': 'effects hidden at multiples of their detection limit',
    'false_alarms': 'unchanged blocks of measured records',
    'repeats': 'the same experiment again, unchanged and with a hidden effect',
    'recorded_voltage': 'voltages that were measured and not commanded',
    'scans': 'triangles at two speeds: why does a scan lag?',
    'mirror': 'a measured mirror of three piezos, its model found step by step',
    'cross_talk': 'simulated stages of three axes, of which some have a hidden cross-talk',
    'story': 'the mode at 68 Hz that the models of Fujii 2018 lack',
}

# What the whole is about, in seconds.
FIRST = 'story'

#: Worlds that return exams.
EXAMS = ('simulated', 'lottery', 'foreign', 'hidden', 'repeats', 'false_alarms')


def main(words: Sequence[str] | None = None) -> int:
    """Run the study of a world; its module has `configure`, `QUICK` and `run`."""
    given = list(sys.argv[1:] if words is None else words)
    if not given or (given[0].startswith('-') and given[0] not in ('-h', '--help')):
        given.insert(0, FIRST)
    chooser = argparse.ArgumentParser(
        description=(__doc__ or '').splitlines()[0],
        formatter_class=argparse.RawDescriptionHelpFormatter,
        epilog='worlds:\n' + '\n'.join(f'  {name:<20} {text}' for name, text in WORLDS.items()),
    )
    chooser.add_argument(
        'world', choices=WORLDS, help=f'followed by its options, as --quick (default: {FIRST})'
    )
    name = chooser.parse_args(given[:1]).world
    world = importlib.import_module(f'studies.worlds.{name}')
    parser = argparse.ArgumentParser(
        prog=f'{chooser.prog} {name}',
        description=world.__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add = parser.add_argument
    add('--seed', type=int, default=0)
    add('--workers', type=int, default=1)
    if 'time_limit' in world.QUICK:
        add('--time-limit', type=float, default=math.inf, help='of each search [s]')
    if name in EXAMS:
        add('--exams', type=Path, help='also store the result there: docs/exams.json')
    else:
        add('--page', type=Path, help='also write the page of documentation')
    world.configure(parser)
    asked = parsed(parser, given[1:], **world.QUICK)
    found: str | list[Exam] = world.run(asked)
    if isinstance(found, str):
        print(found)
        if asked.page:
            asked.page.write_text(found, encoding='utf-8')
        return 0
    for exam in found:
        print(f'\n{name} {exam.variant}\n{exam.text()}')
        if asked.exams:
            exam.store(asked.exams)
    return 0


if __name__ == '__main__':
    sys.exit(main())

"""``python -m piezo_hysteresis VERB``: runs the module of the verb; an error is one line."""

from __future__ import annotations

import argparse
import importlib
import sys
import traceback
import warnings
from collections.abc import Sequence
from types import ModuleType
from typing import TextIO

from piezo_hysteresis import __version__
from piezo_hysteresis.cli import verbosity
from piezo_hysteresis.common.wording import OneLineParser, near
from piezo_hysteresis.errors import DataNote, PiezoError

# The module of each verb and its line in the overview, which imports none of them. A module
# provides EXAMPLE (arguments), configure(parser) and run(arguments) -> exit code.
VERBS = {
    'import': ('import_data', 'convert files to one bag, one record per file'),
    'export': ('export', 'write records as files, or a model as a C library'),
    'info': ('info', 'list records, topics, rates, gaps and units of bags and files'),
    'sweep': ('sweep', 'measure a sweep on a controller (PI, GCS 2; piezosystem jena, NV200)'),
    'identify': ('identify', 'identify a model from records'),
    'validate': ('validate', 'compare a saved model with records that were not fitted'),
    'compensate': ('compensate', 'simulate a compensation, or run it on a controller'),
    'linear': ('linear', 'fit a transfer function to records, for H-infinity'),
    'discover': ('discover', 'find the effects that a model lacks in recorded data'),
    'investigate': ('investigate', 'find them by experiments on the running actuator'),
    'batch': ('batch', 'identify or discover in many data sets; continues after a kill'),
    'record': ('record', 'record topics of a running ROS 2 system into a bag'),
    'play': ('play', 'publish the topics of a bag'),
    'loop': ('loop', 'run the loop with its live page in one terminal'),
    'node': ('node', 'run one node, as ros2 run does'),
    'param': ('param', 'list, get, set and load parameters of running nodes'),
    'call': ('call', 'call services and actions of running nodes, such as run_sweep'),
    'dashboard': ('dashboard', 'serve the live page of running nodes'),
    'demo': ('demo', 'record, identify, compensate and report; or identify your own record'),
    'completion': ('completion', 'print the shell completion for bash, zsh or tcsh'),
}
# Verbs whose arguments after the name belong to a node or another verb.
PLAIN = ('node', 'batch')


def load_verb(verb: str) -> ModuleType:
    """Import the module of `verb`; the others stay unloaded for a fast start."""
    return importlib.import_module(f'piezo_hysteresis.cli.{VERBS[verb][0]}')


def parser_of(verb: str) -> OneLineParser:
    """Return the parser of a verb, without the options that all verbs have."""
    module = load_verb(verb)
    parser = OneLineParser(
        prog=f'piezo_hysteresis {verb}',
        description=module.__doc__,
        epilog=f'example:\n  piezo {module.EXAMPLE}',
    )
    module.configure(parser)
    return parser


def main(arguments: Sequence[str] | None = None, verb: str | None = None) -> int:
    """Run the command line."""
    given = list(sys.argv[1:] if arguments is None else arguments)
    if verb is not None:
        given = [verb, *given]
    try:
        with warnings.catch_warnings():
            warnings.showwarning = _print_warning
            return _run(given)
    except PiezoError as error:
        if verbosity.level() == verbosity.Verbosity.VERBOSE:
            traceback.print_exc()
        print(f'error: {error}', file=sys.stderr)
        return 2


def _print_warning(
    message: Warning | str,
    category: type[Warning],
    filename: str,
    lineno: int,
    file: TextIO | None = None,
    line: str | None = None,
) -> None:
    """Print a warning as one line, without its source location."""
    kind = 'note' if issubclass(category, DataNote) else 'warning'
    if category.__name__ == 'DamageWarning':  # by name: not every verb imports its module
        kind = 'salvaged'
    verbosity.warn(str(message), kind)


def _run(given: list[str]) -> int:
    early, given = verbosity.early_flags(given)
    verb = given[0] if given else ''
    if verb not in VERBS:
        if verb and not verb.startswith('-'):
            raise PiezoError(f'there is no verb {verb}{near(verb, VERBS)}; see --help')
        return _overview(given)
    module = load_verb(verb)
    parser = parser_of(verb)
    if verb not in PLAIN:
        verbosity.add_verbosity_options(parser)
    plain = verb in PLAIN
    arguments = parser.parse_args(given[1:] if plain else [*early, *given[1:]])
    verbosity.choose(verbosity.parsed(early) if plain else arguments)
    replaces = _prepared(arguments, verb)
    code = int(module.run(arguments))
    if replaces and code == 0:
        verbosity.warn(f'{arguments.out}: {replaces} are replaced', 'note')
    return code


def _prepared(arguments: argparse.Namespace, verb: str) -> str:
    """Require a folder for the results; return a description of the earlier ones in it."""
    if not hasattr(arguments, 'overwrite'):
        return ''
    from piezo_hysteresis.reporting.folder import check_folder, marker_of, overwrite

    earlier = marker_of(arguments.out)
    owner = f'batch {arguments.each}' if verb == 'batch' else verb
    if arguments.overwrite:
        overwrite(arguments.out, owner)
    check_folder(arguments.out, owner)
    if earlier is None or verb == 'batch':
        return ''
    return f'the results of an earlier {earlier.verb}'


def _overview(given: list[str]) -> int:
    parser = OneLineParser(
        prog='piezo_hysteresis',
        description='Identify and compensate piezo hysteresis; find effects that a model lacks.',
    )
    parser.add_argument('--version', action='version', version=__version__)
    verbs = parser.add_subparsers(title='verbs', metavar='VERB', required=True)
    for verb, (_, line) in VERBS.items():
        verbs.add_parser(verb, help=line, add_help=False)
    parser.parse_args(given)
    return 2  # pragma: no cover - argparse has exited

"""Print a script for shell completion of verbs and options: source <(piezo completion bash)."""

from __future__ import annotations

import argparse

EXAMPLE = 'completion bash'

# Name of the command in bin/ and in pip installations of `python -m piezo_hysteresis`.
COMMAND = 'piezo'


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of this verb."""
    parser.add_argument('shell', choices=('bash', 'zsh', 'tcsh'), help='shell')


def run(arguments: argparse.Namespace) -> int:
    """Print the script."""
    import shtab

    print(shtab.complete(whole_parser(), arguments.shell))
    return 0


def whole_parser() -> argparse.ArgumentParser:
    """Return one parser of all verbs that completes file and folder names."""
    import shtab

    from piezo_hysteresis.cli import verbosity
    from piezo_hysteresis.cli.main import PLAIN, VERBS, load_verb

    whole = argparse.ArgumentParser(prog=COMMAND)
    verbs = whole.add_subparsers(metavar='VERB')
    for verb, (_, line) in VERBS.items():
        module = load_verb(verb)
        parser = verbs.add_parser(verb, help=line)
        module.configure(parser)
        if verb not in PLAIN:
            verbosity.add_verbosity_options(parser)
        for action in parser._actions:
            kind = {'DIR': shtab.DIRECTORY, 'BAG': shtab.DIRECTORY}.get(str(action.metavar))
            takes = action.metavar in ('DATA', 'FILE', 'YAML', 'NAME|YAML', 'MODEL')
            if kind or takes:
                action.complete = kind or shtab.FILE  # type: ignore[attr-defined]
    return whole

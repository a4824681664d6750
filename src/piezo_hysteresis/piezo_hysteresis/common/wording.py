"""Texts that all command lines share: similar names, plurals, errors in one line."""

from __future__ import annotations

import argparse
import difflib
import errno
import re
import sys
from collections import ChainMap
from collections.abc import Iterable, Mapping, Sequence
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, ClassVar, NoReturn

_SHORT_LIST = 16  # longer lists hide the name that was meant


def near(name: str, known: Iterable[str]) -> str:
    """Return ``' (did you mean X?)'`` where `name` is nearly one of `known`, '' elsewhere."""
    lower = {each.lower(): each for each in known if each != name}
    found = difflib.get_close_matches(name.lower(), lower, n=1, cutoff=0.6)
    matching = [each for each in lower if len(name) > 1 and each.startswith(name.lower())]
    if not found and len(matching) == 1:
        found = matching
    return f' (did you mean {lower[found[0]]}?)' if found else ''


_NONE: Mapping[str, str] = MappingProxyType({})
# Calls of other libraries, and the one here.
_CALLS = {
    'compensate': 'ph.compensate(model, reference)',
    'discover': 'ph.discover(records, model)',
    'feedforward': 'model.inverse(reference, dt)',
    'fit': 'ph.identify(records)',
    'identify': 'ph.identify(records)',
    'predict': 'ph.simulate(model, records)',
    'read_csv': 'ph.load(file)',
    'show': 'plot(), then matplotlib.pyplot.show()',
    'simulate': 'ph.simulate(model, records)',
    'to_csv': 'to_frame().to_csv(path)',
    'to_dataframe': 'to_frame() of records, models and results',
    'to_frame': 'to_frame() of records, models and results',
    'to_pandas': 'to_frame() of records, models and results',
    'validate': 'ph.validate(records, model)',
}


def missing(name: str, known: Iterable[str], own: Mapping[str, str] = _NONE) -> str:
    """Return ``'; use CALL'`` or `near` for a name that is no attribute.

    `own` holds by the right call the wrong names for it, in addition to `_CALLS`.
    """
    calls = {wrong: call for call, names in own.items() for wrong in names.split()}
    call = calls.get(name) or _CALLS.get(name)
    return f'; use {call}' if call else near(name, known)


class Guided:
    """Its wrong attributes name the right ones: those of a table, else the nearest."""

    #: Wrong names of attributes by the right one.
    _INSTEAD: ClassVar[Mapping[str, str]] = _NONE

    if not TYPE_CHECKING:

        def __getattr__(self, name: str) -> Any:
            kind = type(self)
            what = f'{kind.__name__} has no attribute {name!r}'
            if name.startswith('_'):
                raise AttributeError(what)
            names = [*dir(kind), *getattr(kind, '__dataclass_fields__', ())]
            known = [each for each in names if not each.startswith('_')]
            own = ChainMap(*(vars(base).get('_INSTEAD', {}) for base in kind.__mro__))
            raise AttributeError(what + missing(name, known, own))


def choices(name: object, known: Iterable[str]) -> str:
    """Return the similar name in `known` and the whole list; of a long list the similar name only.

    It continues a sentence: ``' (did you mean X?); choose one of X, Y'``.
    """
    names = list(known)
    similar = near(name, names) if isinstance(name, str) else ''
    if similar and len(names) > _SHORT_LIST:
        return similar
    return f'{similar}; choose one of {", ".join(names)}'


# Reasons of the system in words; others keep the text of the system.
_REASONS = {
    errno.ENOENT: 'the path does not exist',
    errno.EACCES: 'access is denied',
    errno.EPERM: 'access is denied',
    errno.EROFS: 'the file system is read-only',
    errno.ENOSPC: 'the disk is full',
    errno.EISDIR: 'it is a folder',
    errno.ENOTDIR: 'a part of the path is a file',
    errno.EEXIST: 'it exists already',
    errno.ENAMETOOLONG: 'the name is too long',
    errno.EMFILE: 'too many files are open',
    errno.EADDRINUSE: 'the address is in use',
    errno.ECONNREFUSED: 'the connection was refused',
    errno.ECONNRESET: 'the connection was reset',
    errno.EHOSTUNREACH: 'the host cannot be reached',
    errno.ETIMEDOUT: 'there was no response in time',
}


def reason_of(error: object) -> str:
    """Return the reason of an error in one line, without errno and path."""
    known = _REASONS.get(getattr(error, 'errno', None) or 0)
    return known or ' '.join(str(getattr(error, 'strerror', None) or error).split())


def enumerated(names: Sequence[str]) -> str:
    """Return ``A, B and C``; there must be a name."""
    return names[0] if len(names) == 1 else f'{", ".join(names[:-1])} and {names[-1]}'


_PLURALS = {'axis': 'axes', 'is': 'are', 'was': 'were', 'has': 'have'}


def counted(number: int, noun: str, verb: str = '') -> str:
    """Return ``1 record`` or ``2 records``, with a verb ``1 record is`` or ``2 records are``."""
    if number == 1:
        return f'1 {noun} {verb}'.rstrip()
    several = _PLURALS.get(noun, f'{noun}s')
    return f'{number} {several} {_PLURALS.get(verb, verb.removesuffix("s"))}'.rstrip()


def not_numbers(number: int) -> str:
    """Return the predicate of a count of values that are not numbers."""
    return 'is not a number' if number == 1 else 'are not numbers'


def short(number: float) -> str:
    """Return three digits of a positive number, without an exponent from 0.001 to 1e9."""
    return f'{number:.0f}' if 100.0 <= number < 1e9 else f'{number:.3g}'


class DefaultsFormatter(argparse.HelpFormatter):
    """Adds the default to each help text that states none, and prints an epilog unwrapped."""

    def _get_help_string(self, action: argparse.Action) -> str:
        text, default = action.help or '', action.default
        if action.nargs == 0 or default in (None, '', argparse.SUPPRESS) or 'default' in text:
            return text
        if default in ((), [], {}):
            return text
        if isinstance(default, (list, tuple)):
            default = ' '.join(f'{each:g}' for each in default)
        shown = f'{default:g}' if isinstance(default, float) else str(default)
        return f'{text} (default {shown})'.lstrip()

    def _fill_text(self, text: str, width: int, indent: str) -> str:
        if text.startswith('example:'):
            return text
        return super()._fill_text(text, width, indent)


# What begins with a minus and is no option: numbers, and lists and ranges of them.
_NEGATIVE = re.compile(r'-(\d|\.\d|inf\b|nan\b)[-+\d.eE,:]*$')


class OneLineParser(argparse.ArgumentParser):
    """Reports an error of the command line in one sentence; ``--help`` prints the usage."""

    def __init__(self, *given: Any, **options: Any) -> None:
        options.setdefault('formatter_class', DefaultsFormatter)
        super().__init__(*given, **options)
        self._negative_number_matcher = _NEGATIVE  # that of argparse knows no exponent

    def parse_args(self, args: Any = None, namespace: Any = None) -> Any:
        """Parse; a mistyped option is named before what seems to be missing for it."""
        given = list(sys.argv[1:] if args is None else args)
        foreign = (argparse.REMAINDER, argparse.PARSER)  # arguments of another program follow
        if not any(action.nargs in foreign for action in self._actions):
            for word in given:
                name = word.partition('=')[0]
                known = [each for each in self._option_string_actions if each.startswith(name)]
                if re.match('--[a-z]', name) and not known:
                    self.error(f'unrecognized arguments: {name}')
        return super().parse_args(given, namespace)

    def error(self, message: str) -> NoReturn:
        """End with exit code 2."""
        self.exit(2, f'error: {self._sentence(message)}; see {self.prog} --help\n')

    def _sentence(self, message: str) -> str:
        if found := re.fullmatch('the following arguments are required: (.*)', message):
            names = [name for name in found.group(1).split(', ') if name != '...']
            verb = 'is' if len(names) == 1 else 'are'
            return f'{" and ".join(map(self._written, names))} {verb} missing'
        if found := re.fullmatch('unrecognized arguments: (.*)', message):
            word = found.group(1).split()[0].partition('=')[0]
            return f'{word} is not understood{near(word, _options(self))}'
        form = r"argument (.*): invalid choice: '(.*?)' \(choose from (.*)\)"
        if found := re.fullmatch(form, message):
            what, word, known = found.groups()
            names = known.replace("'", '').split(', ')
            return f'{what} {word} is unknown{near(word, names)}: choose {", ".join(names)}'
        return message

    def _written(self, name: str) -> str:
        """Return an argument as written, with its value."""
        for action in self._actions:
            if name in (*action.option_strings, action.metavar, action.dest):
                value = f' {action.metavar}' if action.option_strings and action.metavar else ''
                return f'{name}{value}'
        return name


def _options(parser: argparse.ArgumentParser) -> set[str]:
    """Return the options of a parser and of the verbs below it."""
    found = set(parser._option_string_actions)
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            found.update(*map(_options, action.choices.values()))
    return found

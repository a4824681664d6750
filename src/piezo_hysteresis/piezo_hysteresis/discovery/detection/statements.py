"""Detection limits in words: one line per effect, from its smallest to its largest limit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import isfinite

from piezo_hysteresis.discovery.detection.limits import DetectionLimit
from piezo_hysteresis.models.effects import is_never_reached

# Prefixes of SI units, and the power of ten of each.
_PREFIXES = (('n', -9), ('µ', -6), ('m', -3), ('', 0), ('k', 3), ('M', 6))
# Units without SI prefixes.
_BARE = ('1', '1/s', '1/V')
# Value from which a threshold counts as infinite.
_INFINITE = 1e5
# Number of experiments that are recommended; the table of the report has all.
_RECOMMENDED = 2
# Relative difference below which two sizes count as equal.
_ALIKE = 0.15


@dataclass(frozen=True)
class Statement:
    """Detection limit of one effect in words."""

    effect: str  # name of the effect
    brief: str  # range of the smallest detectable sizes
    sizes: str  # these sizes with the shape parameters for which they are valid
    displacement_m: tuple[float, float]  # [m]
    apart: str  # most similar effect and the size from which on it can be distinguished
    hidden: str  # shapes that the records do not show at any size; empty if there are none
    better: str  # experiment that lowers the largest limit most, with the size that it shows


def statements(limits: Sequence[DetectionLimit]) -> tuple[Statement, ...]:
    """Return one statement per effect, for its first variant."""
    found: dict[str, list[DetectionLimit]] = {}
    for each in limits:
        found.setdefault(each.effect, []).append(each)
    return tuple(_statement(name, group) for name, group in found.items())


def _statement(name: str, group: Sequence[DetectionLimit]) -> Statement:
    first = [each for each in group if each.variant == group[0].variant]
    shown = _distinct([each for each in first if each.shown])
    hidden = {_shape(each): None for each in first if not each.shown}
    rms = [each.displacement_rms_m for each in shown] or [float('nan')]
    alike = [each for each in shown if each.apart_factor > 1.0]
    worst = max(alike, key=lambda each: each.apart_factor, default=None)
    return Statement(
        name,
        _brief(shown),
        '; '.join(map(_size, shown)) or 'no size',
        (min(rms), max(rms)),
        '' if worst is None else f'{worst.nearest} below {worst.apart_factor:.2g} times that',
        ', '.join(filter(None, hidden)) or ('any' if hidden and not shown else ''),
        next(
            (
                f'{better.name}: {_size(replace(each, size=better.size))}'
                for each in first
                if (better := each.better) is not None
            ),
            '',
        ),
    )


def recommendations(limits: Sequence[DetectionLimit]) -> tuple[str, ...]:
    """Return a sentence for each of the experiments that lower most limits."""
    lowered: dict[str, dict[str, str]] = {}
    for each in limits:
        if each.better is None:
            continue
        before = _brief([each]) if each.shown else 'no size'
        after = _brief([replace(each, size=each.better.size)])
        lowered.setdefault(each.better.name, {})[each.effect] = (
            f'{each.effect} from {before} to {after}'
        )
    ordered = sorted(lowered.items(), key=lambda each: -len(each[1]))
    return tuple(
        f'To show smaller effects: {name} ({", ".join(texts.values())}).'
        for name, texts in ordered[:_RECOMMENDED]
    )


def _distinct(limits: Sequence[DetectionLimit]) -> list[DetectionLimit]:
    """Return the limits sorted by size, without those that differ only in sign."""
    found: list[DetectionLimit] = []
    for each in sorted(limits, key=lambda each: _numbers(each)[0][1] if _numbers(each) else 0.0):
        one = _numbers(each)
        if not any(each.shape == other.shape and _alike(one, _numbers(other)) for other in found):
            found.append(each)
    return found


def _alike(one: list[tuple[str, float]], other: list[tuple[str, float]]) -> bool:
    return [k for k, _ in one] == [k for k, _ in other] and all(
        abs(a - b) <= _ALIKE * max(a, b) for (_, a), (_, b) in zip(one, other, strict=True)
    )


def _numbers(limit: DetectionLimit) -> list[tuple[str, float]]:
    """Return the distance of each size from its neutral value.

    Thresholds are returned unchanged.
    """
    found = []
    for name, value in limit.size.items():
        neutral = limit.neutral[name]
        size = abs(value) if is_never_reached(neutral) else abs(value - neutral)
        if 0.0 < size < _INFINITE:
            found.append((name, size))
    return found


def _brief(limits: Sequence[DetectionLimit]) -> str:
    """Return the range of sizes of sorted limits."""
    ends = [_numbers(each)[0] for each in (*limits[:1], *limits[-1:]) if _numbers(each)]
    if not ends:
        return 'no size'
    texts = [_value(size, limits[0].units[name]) for name, size in ends if name == ends[0][0]]
    return ' to '.join(dict.fromkeys(texts))


def _size(limit: DetectionLimit) -> str:
    numbers = _numbers(limit)
    if len(numbers) > 1 and len({size for _, size in numbers}) == 1:
        name, size = numbers[0]
        text = f'{name} and the like {_value(size, limit.units[name])}'
    else:
        text = ', '.join(f'{name} {_value(size, limit.units[name])}' for name, size in numbers)
    shape = _shape(limit)
    return f'{text} ({shape})' if shape else text


def _value(size: float, unit: str) -> str:
    return f'{100.0 * size:.2g} %' if unit == '1' else in_prefixes(size, unit)


def _shape(limit: DetectionLimit) -> str:
    return ', '.join(f'{k} {in_prefixes(v, limit.units[k])}' for k, v in limit.shape.items())


def in_prefixes(value: float, unit: str) -> str:
    """Return a number with an SI prefix and up to three digits: ``0.19 ms``, ``17 nm/s``."""
    if unit in _BARE or unit.startswith('1/') or value == 0.0 or not isfinite(value):
        return f'{value:.2g}' + ('' if unit == '1' else f' {unit}')
    prefix, power = next(
        (pair for pair in reversed(_PREFIXES) if abs(value) >= 10.0 ** pair[1]), _PREFIXES[0]
    )
    return f'{value / 10.0**power:.3g} {prefix}{unit}'


def sentence(found: Sequence[Statement]) -> str:
    """Return the range of all limits in the response as a sentence, empty without a limit."""
    seen = sorted(
        (each for each in found if isfinite(each.displacement_m[1])),
        key=lambda each: each.displacement_m[1],
    )
    if not seen:
        return ''
    low, high = seen[0].displacement_m[1], seen[-1].displacement_m[1]
    hidden = [each.effect for each in found if not isfinite(each.displacement_m[1])]
    more = f' They would not show {", ".join(hidden)} at any size.' if hidden else ''
    return (
        f'These records would have shown {len(seen)} known effects: from {in_prefixes(low, "m")} '
        f'rms of the response ({seen[0].effect}) to {in_prefixes(high, "m")} '
        f'({seen[-1].effect}).{more}'
    )

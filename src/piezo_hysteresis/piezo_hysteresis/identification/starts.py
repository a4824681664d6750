"""Start values from the data: nonlinear parameters are scanned, linear ones solved exactly."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.blocks.base import Tuned
from piezo_hysteresis.identification.linear_fit import Simulated, linear_parameters, solve_linear
from piezo_hysteresis.identification.objective import Objective
from piezo_hysteresis.identification.targets import WAY_IN, Target
from piezo_hysteresis.models import Model

_SCAN_RECORDS = 4
_SCAN_SAMPLES = 20_000  # compared samples of a whole record; more samples do not find other basins
_SCAN_LENGTH = 100_000  # simulated samples of a whole record
# Lines of a record that are candidates of a resonance, how far they stand out of the median, and
# the least input of a line over the largest, which keeps harmonics behind a resonance.
_LINES, _STANDS_OUT, _LEAST_INPUT = 3, 8.0, 0.03


@dataclass(frozen=True)
class Start:
    """Start values with their cost."""

    values: dict[str, float]  # every parameter of the chain, and the sampling offset
    cost: float  # sum of squares over the scanned records [m^2]


def starts(
    model: Model,
    targets: Sequence[Target],
    free: Sequence[str],
    given: Mapping[str, float] | None = None,
    *,
    count: int = 8,
    offsets: Sequence[float] = (0.0,),  # [s]
    stopped: Callable[[], bool] = lambda: False,
    simulated: Simulated | None = None,
) -> list[Start]:
    """Return up to `count` start points that lie in different basins, the best first.

    Resonance and memory are scanned together first, because a wrong one hides the other; then the
    shape of the loop (beta, gamma) in units of the amplitude, and the resonance once more. Gains,
    weights and offset are solved exactly at each point, for each sampling offset: the phase of a
    wrong one would be explained by another resonance or loop.
    """
    seen = representative(targets)
    amplitude = max(float(np.max(np.abs(t.voltage))) for t in seen)
    known, simulated = dict(given or {}), simulated or Simulated()
    linear = tuple(n for n in linear_parameters(model, free, amplitude) if n not in known)
    base = {**model.defaults(), **known}
    scanned = [name for name in free if name not in known and name not in linear]

    def evaluated(values: Mapping[str, float]) -> Start:
        solved = solve_linear(model, seen, values, linear, simulated, offsets)
        x = np.array([solved[name] for name in free])
        return Start(solved, Objective(model, seen, free, solved).cost(x))

    otherwise = _stated_otherwise(model, scanned)

    def stated(values: Mapping[str, float], move: Mapping[str, float]) -> Mapping[str, float]:
        return move if otherwise is None else otherwise(values, move)

    pool = [evaluated(base)]
    grid = np.union1d(_frequencies(seen), resonant_lines(targets))
    for kept, moves in _rounds(model, scanned, amplitude, grid):
        for start in _distinct(pool, scanned, kept):
            pool += [
                evaluated({**start.values, **stated(start.values, move)})
                for move in moves
                if not stopped()
            ]
    return _distinct(pool, scanned, count)


def representative(targets: Sequence[Target], count: int = _SCAN_RECORDS) -> list[Target]:
    """Return at most `count` targets over all speeds of the drive, with long ones shortened."""
    records = [t for t in targets if not t.name.endswith(WAY_IN)] or targets
    order = sorted(records, key=lambda t: (_speed(t), t.name))
    if len(order) > count:
        places = np.unique(np.linspace(0, len(order) - 1, count).round().astype(int))
        order = [order[place] for place in places]
    chosen = {target.name for target in order}
    # the transient excites a resonance that a slow sine does not show
    ways_in = [t for t in targets if t.repeats == 1 and t.name.removesuffix(WAY_IN) in chosen]
    return [_cut(t) for t in [*order, *(t for t in ways_in if t.name not in chosen)]]


def _speed(target: Target) -> float:
    """Return the mean frequency of the compared part of a drive [Hz], whatever its form."""
    u = target.voltage[target.first :]
    size = float(np.std(u))
    # rounded: records that differ by noise keep the order of their names
    return float(f'{np.std(np.diff(u)) / (2.0 * np.pi * target.dt * size):.2g}') if size else 0.0


def _cut(target: Target) -> Target:
    """Decimate a long record, and shorten it to the limit of a scan."""
    if target.repeats > 1:
        return target
    end = min(target.voltage.size, max(_SCAN_LENGTH, target.first + _SCAN_SAMPLES))
    kept = target.measured[: len(range(target.first, end, target.stride))]
    thin = max(1, kept.size // _SCAN_SAMPLES)

    def thinned(row: FloatArray | None) -> FloatArray | None:
        return None if row is None else np.ascontiguousarray(row[: kept.size : thin])

    return replace(
        target,
        voltage=target.voltage[:end],
        measured=np.ascontiguousarray(kept[::thin]),
        stride=target.stride * thin,
        valid=thinned(target.valid),
        influence=thinned(target.influence),
    )


def _rounds(
    model: Model, scanned: Sequence[str], amplitude: float, grid: FloatArray
) -> Iterator[tuple[int, list[dict[str, float]]]]:
    """Yield the rounds of the scan: number of points that are kept, and the moves of each."""
    limits = {q.name: (q.low, q.high) for q in model.parameters}

    def allowed(moves: list[dict[str, float]]) -> list[dict[str, float]]:
        return [
            move
            for move in moves
            if all(_within(value, limits.get(name)) for name, value in move.items())
        ]

    stated = _stated_otherwise(model, scanned)
    light = stated is not None or 'natural_frequency' in scanned
    damped = stated is not None or 'damping_ratio' in scanned
    damping = (0.003, 0.01, 0.03, 0.1, 0.3, 1.0) if damped else ()
    memory = np.array([0.1, 0.3, 1.0, 3.0, 10.0]) / amplitude if 'beta' in scanned else ()
    if light:
        yield (
            1,
            allowed(_grid(natural_frequency=grid, damping_ratio=damping[2:3], beta=memory[1:4])),
        )
        yield 4, allowed(_grid(damping_ratio=damping))
    if 'beta' in scanned:
        moves = _grid(beta=memory, gamma=(-0.5, 0.0, 0.5) if 'gamma' in scanned else ())
        for move in moves:
            if 'gamma' in move:
                move['gamma'] *= move['beta']
        yield 4, allowed(moves)
    if light:
        yield 1, allowed(_grid(natural_frequency=grid, damping_ratio=damping[1:4:2]))


def _within(value: float, limits: tuple[float, float] | None) -> bool:
    return limits is None or limits[0] <= value <= limits[1]


def _stated_otherwise(model: Model, scanned: Sequence[str]) -> Tuned | None:
    """Return the parameters of a scanned mode that has no parameter for its frequency."""
    for block in model.blocks:
        names = [q.name for q in block.parameters if q.name in scanned]
        if block.tuned is not None and names:
            return block.tuned
    return None


def _grid(**axes: Sequence[float] | FloatArray) -> list[dict[str, float]]:
    used = {name: axis for name, axis in axes.items() if len(axis)}
    return [
        dict(zip(used, (float(v) for v in point), strict=True))
        for point in product(*used.values())
    ]


def _frequencies(targets: Sequence[Target]) -> FloatArray:
    """Return candidates of a resonance, from the slowest drive to half the sampling rate."""
    slowest = min((t.frequency for t in targets if t.frequency > 0), default=0.0)
    longest = max(t.measured.size * t.stride * t.dt for t in targets)
    low = max(2 * slowest, 4 / longest)
    high = 0.45 / min(t.dt for t in targets)
    return np.geomspace(low, high, 2 + round(6 * np.log2(high / low)))


def resonant_lines(targets: Sequence[Target]) -> FloatArray:
    """Return frequencies at which records move much for their input, shape (k,) [Hz].

    A lightly damped resonance is narrower than the steps of a scan.
    """
    found = list[float]()
    for target in targets:
        count = target.measured.size
        window = np.hanning(count) if target.repeats == 1 else np.ones(count)
        moved = target.measured if target.valid is None else target.measured * target.valid
        driven = target.voltage[target.first :: target.stride][:count]
        y, u = (np.abs(np.fft.rfft(window * (x - np.mean(x)))) for x in (moved, driven))
        peak = (y[1:-1] > y[:-2]) & (y[1:-1] >= y[2:]) & (y[1:-1] > _STANDS_OUT * np.median(y))
        score = np.where(peak, y[1:-1] ** 2 / (u[1:-1] + _LEAST_INPUT * u.max() + 1e-300), 0.0)
        best = [k for k in np.argsort(-score)[:_LINES].tolist() if score[k] > 0.0]
        found += [(k + 1) / (count * target.stride * target.dt) for k in best]
    return np.unique(np.array(found, np.float64))


def _distinct(pool: Sequence[Start], scanned: Sequence[str], count: int) -> list[Start]:
    chosen: list[Start] = []
    for start in sorted(pool, key=lambda each: each.cost):
        near = any(
            all(
                abs(start.values[name] - other.values[name])
                <= 0.3 * max(abs(start.values[name]), abs(other.values[name]))
                for name in scanned
            )
            for other in chosen
        )
        if not near and np.isfinite(start.cost):
            chosen.append(start)
        if len(chosen) == count:
            break
    return chosen or [min(pool, key=lambda each: each.cost)]

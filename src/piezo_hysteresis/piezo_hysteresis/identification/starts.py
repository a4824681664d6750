"""Start values from the data: nonlinear parameters are scanned, linear ones solved exactly."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import product
from math import inf

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.blocks.mass_spring import Restated, restated
from piezo_hysteresis.identification.fit_data import WAY_IN, FitData
from piezo_hysteresis.identification.free_run import read, samples_late
from piezo_hysteresis.identification.objective import SAMPLING_OFFSET, Objective, projected
from piezo_hysteresis.identification.sensitivities import FirstStage, sensitivities
from piezo_hysteresis.models import Model
from piezo_hysteresis.numerics.linalg import solve_least_squares
from piezo_hysteresis.numerics.qr import triangle


def linear_parameters(model: Model, free: Sequence[str], amplitude: float) -> tuple[str, ...]:
    """Return the longest leading sequence of unknowns in which the response is jointly affine.

    It is found by superposition on a short test signal and holds for any chain: ``A1, A,
    offset`` of a Bouc-Wen chain (h is homogeneous in A > 0), each weight of a play bank.
    """
    # amplitude [V]
    k = np.arange(240)
    voltage = amplitude * (np.sin(0.19 * k) + 0.35 * np.sin(0.057 * k + 1.0)) / 1.35
    scales = {q.name: q for q in model.parameters}
    found: tuple[str, ...] = ()
    for name in free:
        q = scales.get(name)
        if q is None or q.high - q.low < 4 * q.scale:
            continue
        if _affine(model, (*found, name), voltage):
            found = (*found, name)
    return found


def _affine(model: Model, names: Sequence[str], voltage: FloatArray) -> bool:
    """Return whether the response is affine in `names` and depends on the last of them.

    A parameter without effect at the defaults (the recursion of a harmonic without input, a knot
    outside the signal) only appears to be affine.
    """
    scales = {q.name: q.scale for q in model.parameters}
    base = {**model.defaults(), **dict.fromkeys(names, 0.0)}
    rng = np.random.default_rng(0)
    one = {**base, **{n: float(rng.uniform(0.5, 1.5)) * scales[n] for n in names}}
    two = {**base, **{n: float(rng.uniform(0.5, 1.5)) * scales[n] for n in names}}
    both = {**base, **{n: one[n] + two[n] for n in names}}

    def run(values: Mapping[str, float]) -> FloatArray:
        packed = model.pack(values, checked=False)
        with np.errstate(over='ignore', invalid='ignore', divide='ignore'):  # time constants of 0
            return model.respond(voltage, packed, 1e-3, frequency=10.0)

    zero, first, second, total = run(base), run(one), run(two), run(both)
    scale = float(np.max(np.abs(first - zero), initial=0.0))
    alone = {**base, names[-1]: one[names[-1]]}
    with np.errstate(over='ignore', invalid='ignore'):
        if not np.max(np.abs(run(alone) - zero)) > 0.0:
            return False
        gap = float(np.max(np.abs(first + second - total - zero)))
    return bool(np.isfinite(gap) and gap <= 1e-7 * scale)


@dataclass
class Simulated:
    """Simulations of scanned points, which are also valid for other zeros of the same records."""

    points: dict[bytes, list[list[FloatArray]]] = field(default_factory=dict)
    first: defaultdict[str, FirstStage] = field(default_factory=lambda: defaultdict(FirstStage))


def solve_linear(
    model: Model,
    targets: Sequence[FitData],
    values: Mapping[str, float],
    names: Sequence[str],
    simulated: Simulated,
    offsets: Sequence[float] = (0.0,),  # [s]
) -> dict[str, float]:
    """Return `values` with the unknowns `names` at their least-squares optimum."""
    known = {name: value for name, value in values.items() if name != SAMPLING_OFFSET}
    packed = model.pack({**known, **dict.fromkeys(names, 0.0)}, checked=False)
    key = packed.tobytes()
    if key not in simulated.points:
        every = [
            _factors(model, packed, names, target, simulated.first[target.name], offsets)
            for target in targets
        ]
        simulated.points[key] = [list(each) for each in zip(*every, strict=True)]
    solved = [
        (*_solved(targets, factors, model, names), offset)
        for factors, offset in zip(simulated.points[key], offsets, strict=True)
    ]
    _, best, offset = min(solved, key=lambda each: each[0])
    return {**values, **best, SAMPLING_OFFSET: offset}


def _solved(
    targets: Sequence[FitData], factors: Sequence[FloatArray], model: Model, names: Sequence[str]
) -> tuple[float, dict[str, float]]:
    """Return the norm of the residual and the solution, which is empty if it is not unique."""
    p = len(names)
    if not all(np.all(np.isfinite(each)) for each in factors):
        return inf, {}
    parts = [
        target.weight * (projected(factor, 1) if target.own_zero else factor[:, 1:])
        for target, factor in zip(targets, factors, strict=True)
    ]
    full = triangle(np.ascontiguousarray(np.vstack(parts).T))
    norms = np.linalg.norm(full[:p, :p], axis=0)
    norms[norms == 0.0] = 1.0
    solved = solve_least_squares(full[:p, :p] / norms, full[:p, p], rcond=1e-7)
    if not solved.sound:
        return float(np.linalg.norm(full[:, p])), {}
    limits = {q.name: (q.low, q.high) for q in model.parameters}
    best = {
        name: float(np.clip(value, *limits[name]))
        for name, value in zip(names, solved.values / norms, strict=True)
    }
    moved = full[:, :p] @ np.array([best[name] for name in names])
    return float(np.linalg.norm(full[:, p] - moved)), best


def _factors(
    model: Model, packed: FloatArray, names: Sequence[str], target: FitData, first: FirstStage,
    offsets: Sequence[float],
) -> list[FloatArray]:  # fmt: skip
    """Return R of the QR factorisation of [1, derivatives, residual] by sampling offset."""
    factors = []
    with np.errstate(over='ignore', invalid='ignore'):
        y, rows = sensitivities(
            model, packed, names, target.voltage, target.dt, target.frequency, target.start,
            first=first,
        )  # fmt: skip
        for offset in offsets:
            late = samples_late(model, target.dt, offset)
            error = target.measured - target.pick(read(y, target, late))
            columns = read(rows, target, late)[:, target.compared]
            factors.append(triangle(np.vstack([np.ones_like(error), columns, error])))
    return factors


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
    targets: Sequence[FitData],
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


def representative(targets: Sequence[FitData], count: int = _SCAN_RECORDS) -> list[FitData]:
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


def _speed(target: FitData) -> float:
    """Return the mean frequency of the compared part of a drive [Hz], whatever its form."""
    u = target.voltage[target.first :]
    size = float(np.std(u))
    # rounded: records that differ by noise keep the order of their names
    return float(f'{np.std(np.diff(u)) / (2.0 * np.pi * target.dt * size):.2g}') if size else 0.0


def _cut(target: FitData) -> FitData:
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


def _stated_otherwise(model: Model, scanned: Sequence[str]) -> Restated | None:
    """Return the parameters of a scanned mode that has no parameter for its frequency."""
    for block in model.blocks:
        names = [q.name for q in block.parameters if q.name in scanned]
        if names and (found := restated(block)) is not None:
            return found
    return None


def _grid(**axes: Sequence[float] | FloatArray) -> list[dict[str, float]]:
    used = {name: axis for name, axis in axes.items() if len(axis)}
    return [
        dict(zip(used, (float(v) for v in point), strict=True))
        for point in product(*used.values())
    ]


def _frequencies(targets: Sequence[FitData]) -> FloatArray:
    """Return candidates of a resonance, from the slowest drive to half the sampling rate."""
    slowest = min((t.frequency for t in targets if t.frequency > 0), default=0.0)
    longest = max(t.measured.size * t.stride * t.dt for t in targets)
    low = max(2 * slowest, 4 / longest)
    high = 0.45 / min(t.dt for t in targets)
    return np.geomspace(low, high, 2 + round(6 * np.log2(high / low)))


def resonant_lines(targets: Sequence[FitData]) -> FloatArray:
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

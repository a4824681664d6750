"""A run of blocks integrated by Gauss quadrature within each tick, see `quadrature`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import exp, inf, lgamma, log
from typing import NamedTuple

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.blocks.base import Approach, InterSample, System
from piezo_hysteresis.blocks.transport_delay import in_ticks, shift
from piezo_hysteresis.jit import jit, leaf, scratch
from piezo_hysteresis.models.simulation.state_layout import Layout, PlacedBlock, systems_of
from piezo_hysteresis.models.simulation.state_space import decayed, fastest, in_series, settled

#: Largest product of fastest pole and tick for which a polynomial represents the impulse response.
SLOW = 25.0
_TAIL = 1e-10  # relative error of the polynomial of an impulse response
_OVER = 10.0  # time constants after which a lag has settled
_FEWEST = 4  # Gauss points
_MISSED = 1e-5  # relative quadrature error of the motion within a tick


class NodeValues(NamedTuple):
    """A signal at the nodes within the ticks."""

    values: FloatArray  # (n, pieces, points + 1)
    lasts: FloatArray  # duration of the motion [ticks], shape (n, pieces)
    part: float  # start of the second piece [ticks]
    places: FloatArray  # (points,)
    weights: FloatArray  # (points,)


class Response(NamedTuple):
    """A linear system over one tick, with the impulse response as a polynomial."""

    phi: FloatArray  # transition over the tick, transposed, shape (n, n)
    impulse: FloatArray  # (m + 1, n)
    integral: FloatArray  # (m + 2, n)
    row: FloatArray
    direct: float


def response_of(systems: Sequence[System], dt: float) -> Response:
    """Return `systems` in series over ticks of `dt` [s], with poles below `SLOW` per tick."""
    system = settled(in_series(systems), dt)
    pace = 0.5 * dt * fastest(systems)
    degree = 3 + len(systems)
    # error of the Chebyshev interpolation of an exponential
    while (degree + 1) * log(max(0.5 * pace, 1e-3)) - lgamma(degree + 2) > log(0.5 * _TAIL):
        degree += 1
    places = np.polynomial.chebyshev.chebpts1(degree + 1)
    values = [decayed(system.a, 0.5 * (1.0 - t) * dt) @ system.b * dt for t in places]
    impulse = np.asarray(
        np.polynomial.chebyshev.chebfit(places, np.array(values), degree), dtype=np.float64
    )
    integral = 0.5 * np.polynomial.chebyshev.chebint(impulse, axis=0)
    phi = np.ascontiguousarray(decayed(system.a, dt).T)
    return Response(phi, impulse, np.ascontiguousarray(integral), system.c, system.d)


def gauss_of(
    approach: Approach, systems: Sequence[System], dt: float
) -> tuple[FloatArray, FloatArray]:
    """Return Gauss points and weights on 0..1 for the duration of an approach within a tick.

    Their number follows from the quadrature error of an exponential with the rates of the approach
    and of the linear blocks.
    """
    lasts = min(1.0, _OVER * approach.time / dt) if approach.time > 0.0 else 1.0
    rate = 1.0 + lasts * dt * fastest(systems)
    rate += min(_OVER, dt / approach.time) if approach.time > 0.0 else 0.0
    count = _FEWEST
    while 2 * count * log(rate) + 4 * lgamma(count + 1) - 3 * lgamma(2 * count + 1) > log(_MISSED):
        count += 1
    places, weights = np.polynomial.legendre.leggauss(count)
    return 0.5 * (1.0 + places), 0.5 * weights


@leaf
def approach_one(
    initial: float, target: float, length: float, approach: tuple[float, float], dt: float,
    places: FloatArray, values: FloatArray,
) -> float:  # fmt: skip
    """Fill `values` with the approach from `initial` to `target` within `length` ticks.

    The values are at `places` of the duration of the motion, the last at its end. Returns that
    duration [ticks]. `approach` is (time constant [s], largest rate [1/s]); one of them applies.
    """
    count = places.size
    gap = target - initial
    if approach[0] > 0.0:
        lasts = min(length, _OVER * approach[0] / dt)
        for i in range(count):
            values[i] = target - gap * exp(-lasts * places[i] * dt / approach[0])
        values[count] = target - gap * exp(-length * dt / approach[0])
        return lasts
    most = approach[1] * dt
    if abs(gap) <= most * length:
        lasts = abs(gap) / most if most < inf and most > 0.0 else 0.0
        values[count] = target
    else:
        lasts = length
        values[count] = initial + (most if gap > 0.0 else -most) * length
    for i in range(count):
        values[i] = initial + (values[count] - initial) * places[i]
    return lasts


@jit
def approaches(
    old: FloatArray, new: FloatArray, part: float, state: FloatArray, approach: tuple[float,
    float], dt: float, places: FloatArray, values: FloatArray, lasts: FloatArray,
) -> None:  # fmt: skip
    """Fill `values`, shape (n, pieces, points + 1), and `lasts`, shape (n, pieces).

    Of two pieces the first, `part` of the tick long, approaches the `old` input.
    """
    pieces = lasts.shape[1]
    for k in range(new.size):
        for i in range(pieces):
            first = pieces == 2 and i == 0
            length = part if first else (1.0 - part if pieces == 2 else 1.0)
            target = old[k] if first else new[k]
            lasts[k, i] = approach_one(
                state[0], target, length, approach, dt, places, values[k, i]
            )
            state[0] = values[k, i, places.size]


@leaf
def add_at(t: float, series: FloatArray, factor: float, total: FloatArray) -> None:
    """Add `factor` times the Chebyshev series with coefficients `series` at `t` (Clenshaw)."""
    for i in range(total.size):
        one = two = 0.0
        for j in range(series.shape[0] - 1, 0, -1):
            one, two = series[j, i] + 2.0 * t * one - two, one
        total[i] += factor * (series[0, i] + t * one - two)


@leaf
def weigh(
    lasts: FloatArray, part: float, places: FloatArray, weights: FloatArray,
    impulse: FloatArray, integral: FloatArray, shares: FloatArray,
) -> None:  # fmt: skip
    """Fill `shares`, (pieces, points + 1, n): the weight of each value of one tick in the states.

    A piece is the sum of its constant end value and the difference from it.
    """
    pieces, count = lasts.size, places.size
    shares[:] = 0.0
    for piece in range(pieces):
        begin = part if pieces == 2 and piece == 1 else 0.0
        end = part if pieces == 2 and piece == 0 else 1.0
        last = shares[piece, count]
        add_at(2.0 * end - 1.0, integral, 1.0, last)
        add_at(2.0 * begin - 1.0, integral, -1.0, last)
        moves = lasts[piece]
        for i in range(count if moves > 0.0 else 0):
            t = 2.0 * (begin + moves * places[i]) - 1.0
            add_at(t, impulse, moves * weights[i], shares[piece, i])
            for j in range(last.size):
                last[j] -= shares[piece, i, j]


@jit
def integrate(
    values: FloatArray, lasts: FloatArray, part: float, places: FloatArray, weights: FloatArray,
    y: FloatArray, state: FloatArray, last: FloatArray, phi: FloatArray, impulse: FloatArray,
    integral: FloatArray, row: FloatArray, direct: float, ahead: bool,
) -> None:  # fmt: skip
    """Return the output of linear blocks for `values` within the ticks; `state` in place.

    Several signals with equal durations are processed together: `values` has the shape (signals,
    n, pieces, points + 1), `lasts` (n, pieces), `y` (signals, n), `state` (signals, states).
    ``last`` is the input of each at the end of the last tick. The output is sampled at the end of
    the tick if `ahead`, otherwise at its start.
    """
    signals, n = state.shape
    pieces, count = lasts.shape[1], places.size
    new, shares = scratch(n), scratch((pieces, count + 1, n))
    for k in range(lasts.shape[0]):
        same = k > 0
        for piece in range(pieces):
            same = same and lasts[k, piece] == lasts[k - 1, piece]
        if not same:
            weigh(lasts[k], part, places, weights, impulse, integral, shares)
        for s in range(signals):
            reading = direct * last[s]
            for i in range(n):
                reading += row[i] * state[s, i]
                new[i] = 0.0
            y[s, k] = reading
            for j in range(n):
                for i in range(n):
                    new[i] += phi[j, i] * state[s, j]
            for piece in range(pieces):
                for i in range(count + 1):
                    value = values[s, k, piece, i]
                    for j in range(n):
                        new[j] += shares[piece, i, j] * value
            last[s] = values[s, k, pieces - 1, count]
            reading = direct * last[s]
            for i in range(n):
                state[s, i] = new[i]
                reading += row[i] * new[i]
            if ahead:
                y[s, k] = reading


_AT_ONCE = 1 << 11  # ticks that are integrated at a time


@dataclass(frozen=True)
class QuadratureRun:
    """A monotonic approach, static blocks or memories after it, and linear blocks at the end."""

    first: PlacedBlock  # block that approaches a held input monotonically
    middle: tuple[PlacedBlock, ...]  # blocks after it
    behind: tuple[PlacedBlock, ...]  # the linear blocks at the end
    delays: int  # number of parameters of delays before theirs
    ahead: bool  # whether the output is sampled at the end of the tick and not at its start

    @classmethod
    def of(cls, moving: tuple[PlacedBlock, ...], delays: int, ahead: bool) -> QuadratureRun | None:
        """Return the run of the blocks `moving`, None if they have another structure."""
        last = len(moving)
        while last and moving[last - 1].block.system is not None:
            last -= 1
        if last in (0, len(moving)) or moving[0].block.approach is None:
            return None
        kinds = [part.block.between for part in moving[1:last]]
        memories = [
            part.block for part in moving[1:last] if part.block.between is InterSample.PATH
        ]
        if len(memories) > 1 or any(block.path_kernel is not None for block in memories):
            return None
        if not set(kinds) <= {InterSample.INSTANT, InterSample.PATH}:
            return None
        return cls(moving[0], moving[1:last], moving[last:], delays, ahead)

    def fits(self, p: FloatArray, dt: float) -> bool:
        """Return whether the linear blocks are slow enough for quadrature."""
        return dt * fastest(systems_of(self.behind, p)) <= SLOW

    def respond(
        self, signal: FloatArray, p: FloatArray, dt: float, *, state: FloatArray, layout: Layout
    ) -> FloatArray:
        """Return the output for a held input, one value per tick, updating `state` in place."""
        memories = layout.memories[1 : 1 + len(self.middle)]
        behind = slice(layout.memories[1 + len(self.middle)].start, layout.size)
        output = np.empty_like(signal)
        for begin in range(0, signal.size, _AT_ONCE):
            chunk = slice(begin, begin + _AT_ONCE)
            nodes = self.node_values(signal[chunk], p, dt, state=state, layout=layout)
            flat = nodes.values.ravel()
            for part, place in zip(self.middle, memories, strict=True):
                flat = part.block.respond(flat, p[part.span], dt, state=state[place])
            own = (state[None, behind], state[:1])
            output[chunk] = self.integrated(flat[None], nodes, p, dt, memory=own)[0]
        return output

    def node_values(
        self, signal: FloatArray, p: FloatArray, dt: float, *, state: FloatArray, layout: Layout
    ) -> NodeValues:
        """Return the approach to a held signal at the nodes of each tick; `state` in place."""
        approach, places, weights = self.approach(p, dt)
        whole, part = in_ticks(float(p[: self.delays].sum()), dt)
        old = new = signal
        if self.delays:
            new = np.empty_like(signal)
            shift(signal, new, state[layout.ring], whole)
            old = np.concatenate([state[1:2], new[:-1]])
            state[1] = new[-1]
        pieces = 2 if part > 0.0 else 1
        values = np.empty((signal.size, pieces, places.size + 1))
        lasts = np.empty((signal.size, pieces))
        approaches(old, new, part, state[layout.memories[0]], approach, dt, places, values, lasts)
        return NodeValues(values, lasts, part, places, weights)

    def integrated(
        self,
        rows: FloatArray,  # (signals, values of `nodes`)
        nodes: NodeValues,
        p: FloatArray,  # [s]
        dt: float,  # [s]
        *,
        memory: tuple[FloatArray, FloatArray] | None = None,
    ) -> FloatArray:
        """Return the output of the linear blocks for signals at `nodes`, shape (signals, n)."""
        response = self.response(p, dt)
        if memory is None:
            memory = np.zeros((len(rows), response.row.size)), np.zeros(len(rows))
        output = np.empty((len(rows), nodes.lasts.shape[0]))
        values = rows.reshape(len(rows), *nodes.values.shape)
        integrate(
            values, nodes.lasts, nodes.part, nodes.places, nodes.weights, output, memory[0],
            memory[1], response.phi, response.impulse, response.integral, response.row,
            response.direct, self.ahead,
        )  # fmt: skip
        return output

    def approach(self, p: FloatArray, dt: float) -> tuple[Approach, FloatArray, FloatArray]:
        """Return the approach and its Gauss points, cached for the last parameters."""
        key = (p.tobytes(), dt)
        known: tuple[object, tuple[Approach, FloatArray, FloatArray]] | None
        known = self.__dict__.get('_last_approach')
        if known is None or known[0] != key:
            assert self.first.block.approach is not None
            approach = self.first.block.approach(p[self.first.span])
            known = key, (approach, *gauss_of(approach, systems_of(self.behind, p), dt))
            self.__dict__['_last_approach'] = known
        return known[1]

    def response(self, p: FloatArray, dt: float) -> Response:
        """Return the response of the linear blocks, cached for the last parameters."""
        key = (p.tobytes(), dt)
        known: tuple[object, Response] | None = self.__dict__.get('_last_response')
        if known is None or known[0] != key:
            known = key, response_of(systems_of(self.behind, p), dt)
            self.__dict__['_last_response'] = known
        return known[1]

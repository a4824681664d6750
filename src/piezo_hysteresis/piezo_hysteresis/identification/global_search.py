"""Global searches with one interface: two particle swarms and differential evolution of SciPy.

They use only values of the cost. Each takes a seed, counts its evaluations and works in a box
scaled to the unit cube.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import sqrt

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.common.wording import choices, counted
from piezo_hysteresis.errors import IdentificationError

_PHI = 4.2  # sum of the acceleration coefficients of Fang 2019


@dataclass(frozen=True)
class Swarm:
    """Constants of a particle swarm: ``v <- chi (w v + own r1 (p - x) + common r2 (g - x))``."""

    population: int = 0  # number of particles; 0 is ten per unknown, at least twenty
    constriction: float = 1.0  # chi
    inertia: float = 0.7298
    inertia_end: float = 0.7298
    own: float = 1.4962  # largest acceleration towards the best point of a particle
    common: float = 1.4962  # of the swarm
    tolerance: float = 1e-8

    def __post_init__(self) -> None:
        if self.population != int(self.population) or self.population < 0 or self.population == 1:
            raise IdentificationError(
                f'a swarm has 2 particles or more, or 0 for the usual number, got '
                f'{self.population:g}'
            )
        for name in ('constriction', 'inertia', 'inertia_end', 'own', 'common', 'tolerance'):
            value = getattr(self, name)
            if not 0.0 <= value <= 10.0:
                raise IdentificationError(f'{name} of a swarm lies within 0 .. 10, got {value:g}')


#: The usual convergent set; Zhou 2021 and Xiao 2014 print none.
USUAL = Swarm()
#: Fang 2019: constriction chi of phi = 4.2 and an inertia that falls; its limits are not printed.
FANG = Swarm(
    constriction=2 / abs(2 - _PHI - sqrt(_PHI**2 - 4 * _PHI)),
    inertia=0.9,
    inertia_end=0.4,
    own=_PHI / 2,
    common=_PHI / 2,
)

Cost = Callable[[FloatArray], float]
Progress = Callable[[float, str], None]


@dataclass(frozen=True)
class SearchResult:
    """Result of a search."""

    x: FloatArray  # best point, shape (p,)
    cost: float  # cost there
    evaluations: int  # number of evaluations of the cost
    history: tuple[float, ...]  # best cost after each iteration
    converged: bool  # whether the population converged within the limit of evaluations
    message: str  # reason for the termination


def search(
    cost: Cost,
    low: FloatArray,  # (p,)
    high: FloatArray,  # (p,)
    *,
    method: str = 'de',
    seed: int = 0,
    max_evaluations: int = 4000,
    swarm: Swarm | None = None,
    progress: Progress | None = None,
) -> SearchResult:
    """Minimise `cost` in a box.

    `method` is ``pso`` (Zhou 2021, Xiao 2014), ``pso_modified`` (Fang 2019) or ``de``.
    """
    low, high = np.asarray(low, dtype=float), np.asarray(high, dtype=float)
    if not (np.all(np.isfinite(low)) and np.all(np.isfinite(high)) and np.all(low < high)):
        raise IdentificationError('a search needs finite bounds with low below high; narrow them')
    if method not in METHODS:
        raise IdentificationError(f'search {method!r} is unknown{choices(method, METHODS)}')
    width = high - low
    watch = _Watch(lambda z: cost(low + width * z), low.size, max_evaluations, progress)
    rng = np.random.default_rng(seed)
    swarm = swarm or SWARMS.get(method)
    message = _swarm(watch, rng, swarm) if swarm else _de(watch, rng)
    if not np.isfinite(watch.best):
        raise IdentificationError('every point of the box is impossible; move the bounds')
    return SearchResult(
        x=low + width * watch.at,
        cost=watch.best,
        evaluations=watch.used,
        history=tuple(watch.history),
        converged=bool(message),
        message=message or f'stopped at the limit of {counted(max_evaluations, "evaluation")}',
    )


class _Watch:
    """Counts evaluations in the unit cube and keeps the best point."""

    def __init__(self, cost: Cost, size: int, limit: int, progress: Progress | None) -> None:
        self.cost, self.size, self.limit = cost, size, limit
        self.used = 0
        self.best = float('inf')
        self.at = np.full(size, 0.5)
        self.history: list[float] = []
        self._progress = progress

    @property
    def spent(self) -> bool:
        return self.used >= self.limit

    def costs(self, points: FloatArray) -> FloatArray:
        """Return the costs of points in the unit cube, shape (m, p); one iteration."""
        values = np.full(len(points), np.inf)
        for i, point in enumerate(points[: self.limit - self.used]):
            values[i] = self.cost(point)
            self.used += 1
            if values[i] < self.best:
                self.best, self.at = float(values[i]), point.copy()
        self.history.append(self.best)
        if self._progress is not None:
            self._progress(self.used / self.limit, f'best cost {self.best:.4g}')
        return values


def _swarm(watch: _Watch, rng: np.random.Generator, swarm: Swarm) -> str:
    """Search by a particle swarm; with the constants of Fang 2019: Fang 2019 (swarm)."""
    count = int(swarm.population) or max(20, 10 * watch.size)
    x = rng.random((count, watch.size))
    v = 0.2 * (rng.random(x.shape) - 0.5)
    own, own_cost = x.copy(), watch.costs(x)
    while not watch.spent:
        spent = min(watch.used / watch.limit, 1.0)
        inertia = swarm.inertia + spent * (swarm.inertia_end - swarm.inertia)
        pull = swarm.own * rng.random(x.shape) * (own - x)
        pull += swarm.common * rng.random(x.shape) * (watch.at - x)
        v = np.clip(swarm.constriction * (inertia * v + pull), -0.5, 0.5)
        x = x + v
        out = (x < 0) | (x > 1)
        x = np.clip(x, 0.0, 1.0)
        v[out] *= -0.5  # particles are reflected at a bound, or they would stay at it
        values = watch.costs(x)
        better = values < own_cost
        own[better], own_cost[better] = x[better], values[better]
        finite = own_cost[np.isfinite(own_cost)]
        if finite.size > 1 and np.ptp(finite) <= swarm.tolerance * np.min(finite):
            return 'the swarm agrees'
    return ''


def _de(watch: _Watch, rng: np.random.Generator) -> str:
    """Run the differential evolution of SciPy."""
    from scipy.optimize import differential_evolution

    size = max(12 * watch.size, 8)
    result = differential_evolution(
        lambda z: float(watch.costs(z[None, :])[0]),
        [(0.0, 1.0)] * watch.size,
        popsize=max(size // watch.size, 2),
        maxiter=max(watch.limit // size - 1, 1),
        tol=1e-4,
        atol=0.0,
        polish=False,
        rng=rng,
        callback=lambda intermediate_result: watch.spent,
    )
    return 'the population agrees' if result.success and not watch.spent else ''


SWARMS: dict[str, Swarm] = {'pso': USUAL, 'pso_modified': FANG}
METHODS: tuple[str, ...] = (*SWARMS, 'de')

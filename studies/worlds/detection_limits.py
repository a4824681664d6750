"""Detection limits checked: effects hidden at multiples of their limit, and how many are seen.

Sweeps of a simulated actuator, in which nothing is missing from the baseline, give the limits.
Then each effect, at 0.3 of its limit, at the limit and at twice it, is added to sweeps with other
noise as what the effect's law makes of the model, and the discovery runs again. An effect is seen
where the verdict is not `none`.

    python studies/study.py detection_limits --seed 1 --seeds 3
"""

from __future__ import annotations

import argparse
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.discovery import Discovery, discover
from piezo_hysteresis.discovery.detection.limits import DetectionLimit, scaled
from piezo_hysteresis.identification.error_measures import views_of
from piezo_hysteresis.identification.prediction import predictions
from piezo_hysteresis.models import Model, candidates
from piezo_hysteresis.records import Record
from piezo_sim.sweep import simulate

MULTIPLES = (0.3, 1.0, 2.0)


def sweeps(preset: str, seed: int, seconds: float) -> list[Record]:
    """Return sweeps of a simulated actuator."""
    specs = [
        {'kind': 'sine', 'frequency': f, 'amplitude': 1.0, 'duration': seconds}
        for f in (1.0, 3.0, 8.0, 20.0, 40.0)
    ]
    return list(simulate(preset, specs, seed=seed))


def added(
    found: Discovery, limit: DetectionLimit, multiple: float, records: Sequence[Record]
) -> list[Record]:
    """Return records with what an effect of so many limits adds to the response of the model."""
    final = found.final
    amplitude, span = found.data.amplitude, found.data.span
    candidate = next(
        each
        for each in candidates(final.model, amplitude, span)
        if (each.effect.name, each.effect.variant) == (limit.effect, limit.variant)
    )
    values = candidate.values(final.values, limit.size | limit.shape)
    values = scaled(candidate, values, multiple)
    before = responses(final.model, final.values, final.sampling_offset, records)
    after = responses(candidate.model, values, final.sampling_offset, records)
    return [
        replace(record, displacement=record.displacement + (b - a)[-record.displacement.size :])
        for record, a, b in zip(records, before, after, strict=True)
    ]


def responses(
    model: Model, values: dict[str, float], late: float, records: Sequence[Record]
) -> list[FloatArray]:
    """Return the free run of a model over each record, its zero left as it is [m]."""
    views = [replace(v, own_zero=False) for v in views_of(model, values, records, late)]
    runs = predictions(model, values, views, late, checked=False)
    return [each.displacement for each in runs]


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the options of this world."""
    parser.set_defaults(seed=1)
    parser.add_argument('--preset', default='generic_bouc_wen')
    parser.add_argument('--baseline', default='classical')
    parser.add_argument('--seeds', type=int, default=3)
    parser.add_argument('--seconds', type=float, default=2.0, help='of each sine')
    parser.add_argument('--effects', type=int, default=0, help='how many; all by default')


QUICK = {'seeds': 1, 'effects': 2}


def run(asked: argparse.Namespace) -> str:
    """Return how many hidden effects are seen at each multiple of their limits."""
    seen: Counter[float] = Counter()
    named: Counter[float] = Counter()
    tried: Counter[float] = Counter()
    generator = np.random.default_rng(asked.seed)
    for seed in range(asked.seed, asked.seed + asked.seeds):
        records = sweeps(asked.preset, 1000 + seed, asked.seconds)
        found = discover(records, asked.baseline, seed=seed)
        if found.verdict.verdict != 'none':
            print(f'seed {seed}: {found.verdict.verdict} without any hidden effect')
            continue
        fresh = sweeps(asked.preset, 2000 + seed, asked.seconds)
        limits = drawn(found.verdict.detection_limits, generator)
        for limit in limits[: asked.effects or None]:
            row = []
            for multiple in MULTIPLES:
                verdict = discover(
                    added(found, limit, multiple, fresh), asked.baseline, seed=seed
                ).verdict
                names = [each.name for each in verdict.effects]
                tried[multiple] += 1
                seen[multiple] += verdict.verdict != 'none'
                named[multiple] += limit.effect in names
                row.append(f'{verdict.verdict} {",".join(names)}'.strip())
            print(f'seed {seed} {limit.effect} {limit.variant}: {" | ".join(row)}', flush=True)
    return '\n'.join(
        f'{multiple:g} limits: seen {seen[multiple]} of {tried[multiple]}, '
        f'with its name {named[multiple]}'
        for multiple in MULTIPLES
    )


def drawn(
    limits: Sequence[DetectionLimit], generator: np.random.Generator
) -> list[DetectionLimit]:
    """Return one limit of each effect, its variant and shape drawn."""
    groups: dict[str, list[DetectionLimit]] = {}
    for each in limits:
        if each.shown:
            groups.setdefault(each.effect, []).append(each)
    return [group[int(generator.integers(len(group)))] for group in groups.values()]

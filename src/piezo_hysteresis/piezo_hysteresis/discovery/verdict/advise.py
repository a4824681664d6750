"""Recommended experiments that discriminate the remaining alternatives."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import TYPE_CHECKING

from piezo_hysteresis.discovery.data.check import Check
from piezo_hysteresis.discovery.detection.look_alikes import LookAlike
from piezo_hysteresis.models import Model, described, name_of

if TYPE_CHECKING:
    from piezo_hysteresis.discovery.selection.elimination import Step

ALTERNATIVE_PROBABILITY = 0.02


def instead(model: Model) -> tuple[str, ...]:
    """Return the advice for a model that was tested on the records of its own identification."""
    name = name_of(model)
    by_name = f'To find what the model lacks, give its name: `discover DATA --baseline {name}`.'
    changed = 'To find what has changed since, record new data and pass them with the model file.'
    return (by_name, changed) if name else (changed,)


def advise(
    check: Check,
    steps: Sequence[Step],
    left: bool,
    alike: Mapping[str, Sequence[LookAlike]] = MappingProxyType({}),
) -> list[str]:
    """Return the recommended experiments, most informative first."""
    separated: dict[str, dict[str, None]] = {}  # effects by the experiment that separates them
    for step in steps:
        chances = step.round.probabilities()
        alternatives = [
            name for name, chance in chances.items() if chance > ALTERNATIVE_PROBABILITY
        ]
        similar = (each.name for each in alike.get(step.fit.effect, ()))
        alternatives = list(dict.fromkeys((*alternatives, *similar)))
        if len(alternatives) < 2:
            continue
        for name in alternatives:
            experiment = described(name)[0].experiment
            separated.setdefault(experiment, {}).update(dict.fromkeys(alternatives))
    sentences = [
        f'To distinguish {", ".join(names)}: {experiment[0].lower()}{experiment[1:]}'
        for experiment, names in separated.items()
    ]
    named = {step.fit.effect for step in steps}
    for names, advice in check.confounded:
        if named & set(names) or (left and not steps):
            sentences.append(f'To distinguish {", ".join(names)}: {advice}.')
    if left:
        sentences.append(
            'Repeat the record with the largest residual: a residual that does not repeat is a '
            'disturbance, one that repeats comes from the actuator.'
        )
    if not sentences:
        sentences = [f'To continue: {advice}.' for advice in check.experiments()[:2]]
    return list(dict.fromkeys(sentences))

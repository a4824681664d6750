"""Discovery on several axes: cross-talk of each pair, and what linear modes lack."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise

from piezo_hysteresis.axes import modal_file
from piezo_hysteresis.axes.axes_record import AxesRecord
from piezo_hysteresis.axes.cross_talk import CrossTalk, cross_talk
from piezo_hysteresis.axes.modal_search import ModalIdentification, ModalStep, identify_axes
from piezo_hysteresis.common.wording import Guided
from piezo_hysteresis.errors import IdentificationError
from piezo_hysteresis.models.modelfile import is_there

#: Baselines: a gain of each axis, or linear modes of all axes.
BASELINES = ('gain', 'modes')


@dataclass(frozen=True, repr=False)
class AxesDiscovery(Guided):
    """What records of several axes show beyond a baseline.

    Attributes
    ----------
    baseline : str
        ``gain``, ``modes``, or the file of a model that was kept.
    cross_talk : tuple of CrossTalk
        Pairs of axes, the largest first.
    identification : ModalIdentification or None
        Modal model with its steps, unless the baseline is ``gain``.
    seconds : float
        Computing time [s].
    """

    baseline: str
    cross_talk: tuple[CrossTalk, ...]
    identification: ModalIdentification | None
    seconds: float

    @property
    def steps(self) -> tuple[ModalStep, ...]:
        """Effects that the baseline needed, in the order in which they were added."""
        return self.identification.steps[1:-1] if self.identification else ()

    @property
    def effects(self) -> tuple[str, ...]:
        """Names of what was found."""
        names = sorted({pair.name for pair in self.cross_talk})
        return tuple(dict.fromkeys([*names, *(step.effect for step in self.steps)]))

    @property
    def summary(self) -> str:
        """The verdict in one sentence."""
        if not self.effects:
            return f'Nothing was found beyond the baseline {self.baseline}.'
        return f'Found beyond the baseline {self.baseline}: {", ".join(self.effects)}.'

    @property
    def remark(self) -> str:
        """Doubt about the order of the axes, in one sentence; empty if there is none."""
        large = [each for each in self.cross_talk if abs(each.size) > 1.0]
        if not large:
            return ''
        first = large[0]
        return (
            f'Displacement {first.displacement} moves more with voltage {first.voltage} than '
            'that axis itself: the displacements may be in another order than the voltages, or '
            'measured elsewhere than at the actuators.'
        )

    def __repr__(self) -> str:
        lines = [self.summary, *(f'  {pair}' for pair in self.cross_talk)]
        lines += [f'  {self.remark}'] if self.remark else []
        steps = self.identification.steps[:-1] if self.identification else ()
        for before, step in pairwise(steps):
            lines.append(f'  {step.effect}: {step.sentence}')
            gaps = [
                f'{1e6 * before.held_out[level]:.3g} to {1e6 * left:.3g} µm at {level}'
                for level, left in step.held_out.items()
            ]
            lines.append(f'    held-out error {", ".join(gaps)}')
        return '\n'.join(lines)


def discover_axes(
    records: Sequence[AxesRecord],
    baseline: str = 'modes',
    *,
    workers: int = 1,
    report: Callable[[str], None] = lambda _: None,
    progress: Callable[[float], None] = lambda _: None,
) -> AxesDiscovery:
    """Return the cross-talk of records, and the effects that linear modes lack in them."""
    began, kept = time.perf_counter(), None
    if baseline not in BASELINES:
        if not is_there(baseline):
            raise IdentificationError(
                f'the baseline of several axes is {" or ".join(BASELINES)} or the model.yaml of '
                f'several axes, not {baseline!r}'
            )
        kept = modal_file.load(baseline)
    pairs = cross_talk(records) if kept is None else []
    found = None
    if baseline != 'gain':
        found = identify_axes(
            records, kept=kept, workers=workers, report=report, progress=progress
        )
    return AxesDiscovery(baseline, tuple(pairs), found, time.perf_counter() - began)

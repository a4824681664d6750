"""Whether a gap on held-out records means anything but values that training leaves open."""

from __future__ import annotations

from dataclasses import replace

from piezo_hysteresis.discovery.arena import Arena
from piezo_hysteresis.discovery.trial import Trial, on_views

# A value counts as left open by training if all records tell it so many times better.
OPEN = 1.5
MOST_NAMES = 3


def explained_together(arena: Arena, final: Trial) -> str:
    """Return a sentence where one set of values explains all records, an empty string if none.

    Where the held-out records reach beyond those of training (a chirp into a mode), values that
    training tells badly leave a gap there, although nothing is missing in the model. Then a fit to
    all records leaves nothing anywhere; an effect that the model lacks stays in that fit, too.
    The values of `final` are not touched: what was fitted to all records has nothing left to prove
    itself on.
    """
    held_out = [replace(v, name=f'{v.name} (held out)') for v in arena.data.held_out]
    both = arena.fit_to(final, [*arena.views, *held_out])
    if both is None:
        return ''
    for views in (arena.views, arena.data.held_out):
        if arena.lacks_something(on_views(both, views)):
            return ''
    names = _better_known(final, both)
    which = f' ({", ".join(names)})' if names else ''
    return (
        'One set of values explains all records to the floor: what is left on held-out records '
        f'comes from values that the training records tell badly{which}.'
    )


def _better_known(final: Trial, both: Trial) -> list[str]:
    """Return which values all records tell much better than those of training, worst first."""
    if final.fitted is None or both.fitted is None:
        return []
    before, after = final.fitted.std, both.fitted.std
    ratios = {n: before[n] / max(after[n], 1e-300) for n in before if n in final.model.free_names}
    worst = sorted((n for n, r in ratios.items() if r > OPEN), key=lambda n: -ratios[n])
    return worst[:MOST_NAMES]

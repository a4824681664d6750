"""Parameters that the training records determine poorly and all records determine well."""

from __future__ import annotations

from piezo_hysteresis.discovery.selection.candidate_fit import CandidateFit

# Ratio of standard errors from which training alone determines a value poorly.
_OPEN = 1.5
_MOST_NAMES = 3


def explained_together(training: CandidateFit, both: CandidateFit) -> str:
    """Return a sentence on a held-out gap that a fit to all records closes.

    If the held-out records exceed the range of the training records (a chirp into a mode), values
    that the training records determine poorly cause a gap, although no effect is missing. A fit to
    all records then has no residual; with a missing effect a residual remains in that fit, too.
    The values of `training` stay unchanged, because a model fitted to all records could not be
    tested on any.
    """
    names = _better_determined(training, both)
    which = f' ({", ".join(names)})' if names else ''
    return (
        'One set of values explains all records to the floor: the residual on held-out records '
        f'comes from values that the fitted records determine poorly{which}.'
    )


def _better_determined(training: CandidateFit, both: CandidateFit) -> list[str]:
    """Return the parameters that all records determine much better than training, worst first."""
    if training.fitted is None or both.fitted is None:
        return []
    before, after = training.fitted.std, both.fitted.std
    free = training.model.free_names
    ratios = {n: before[n] / max(after[n], 1e-300) for n in before if n in free}
    worst = sorted((n for n, r in ratios.items() if r > _OPEN), key=lambda n: -ratios[n])
    return worst[:_MOST_NAMES]

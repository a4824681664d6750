"""Which values training leaves open that all records tell."""

from __future__ import annotations

from piezo_hysteresis.discovery.selection.candidate_fit import CandidateFit

# A value counts as left open by training if all records tell it so many times better.
_OPEN = 1.5
_MOST_NAMES = 3


def explained_together(training: CandidateFit, both: CandidateFit) -> str:
    """Return a sentence on a gap that one set of values for all records closes.

    Where the held-out records reach beyond those of training (a chirp into a mode), values that
    training determines badly leave a gap there, although nothing is missing in the model. Then a
    fit to all records leaves nothing anywhere; an effect that the model lacks stays in that fit,
    too. The values of `training` are not touched: what was fitted to all records has nothing left
    to prove itself on.

    Parameters
    ----------
    training, both : CandidateFit
        The model fitted to the training records, and to all.
    """
    names = _better_known(training, both)
    which = f' ({", ".join(names)})' if names else ''
    return (
        'One set of values explains all records to the floor: the residual on held-out records '
        f'comes from values that the fitted records determine poorly{which}.'
    )


def _better_known(training: CandidateFit, both: CandidateFit) -> list[str]:
    """Return which values all records tell much better than those of training, worst first."""
    if training.fitted is None or both.fitted is None:
        return []
    before, after = training.fitted.std, both.fitted.std
    free = training.model.free_names
    ratios = {n: before[n] / max(after[n], 1e-300) for n in before if n in free}
    worst = sorted((n for n, r in ratios.items() if r > _OPEN), key=lambda n: -ratios[n])
    return worst[:_MOST_NAMES]

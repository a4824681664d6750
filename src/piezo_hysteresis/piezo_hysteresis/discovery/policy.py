"""Every number by which a model that knows what it misses tells news and gives names.

A baseline from a ``model.yaml`` brings its values and its discrepancy. Then these numbers decide;
a bare name brings neither, and the numbers beside `search`, `arena` and `compete` do.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class SelectionPolicy:
    """What decides in the held view.

    Attributes
    ----------
    news : float
        Rms of a record over what the model is known to miss there, from which it shows more [1].
        Repeats of fitted sweeps gave 1.00 to 1.02, conditions in between up to 1.31, see
        `identification.comparison.NEWS`.
    part : float
        A line or an octave that exceeds what is known of it by `news` is news for itself where
        the excess is this share of all that is known [1, mean square]. A tone that adds a
        twentieth to the rms is seen, a discrepancy that only changed its shape is not.
    shape : float
        Share of the known mean square that any line or octave may hold without its being told
        [1]: files tell parts from 1e-3 on, and shapes change with the drive.
    octave, line : int
        Independent numbers that an octave, or a harmonic, counts for at most: what a model misses
        is not independent from sample to sample, and a harmonic is a cosine and a sine [1].
    whole : float
        Weight of the whole residual beside its parts [1].
    price : float
        What each fitted parameter costs [nats].
    periods : float
        Periods of a drive from which its harmonics are told apart [1].
    steady : float
        Scatter of the amplitude within a record, over its mean, from which what a model misses is
        taken to follow the amplitude as a parabola [1].
    taper : float
        Share of a record over which it is faded in and out before its spectrum is taken: slow
        effects are largest at the ends, which a full window would hide [1].
    sure : float
        By how many nats, beside the logarithm of the number of candidates, an effect must lower
        the score: exp(-4) is 1 in 55, in records that show news already [nats].
    share : float
        Of the news, in mean square, that an effect must take to be worth its name [1].
    alternative : float
        Probability from which another effect is said beside the one that is named [1].
    effects : int
        Effects that are looked for one after another [1].
    first_fits, last_fits : int
        Candidates that are fitted to short records, and those of them that see all samples [1].
    worse : float
        Share by which the error on held-out records may grow by chance with an effect [1].
    """

    news: float = 1.5
    part: float = 0.1
    shape: float = 0.01
    octave: int = 20
    line: int = 2
    whole: float = 3.0
    price: float = 2.0
    periods: float = 3.0
    steady: float = 0.05
    taper: float = 0.2
    sure: float = 4.0
    share: float = 0.25
    alternative: float = 0.1
    effects: int = 4
    first_fits: int = 24
    last_fits: int = 6
    worse: float = 0.02


POLICY = SelectionPolicy()

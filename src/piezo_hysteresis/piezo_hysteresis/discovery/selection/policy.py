"""Every number by which discovery decides: name, value, unit, what it means and where it is from.

A number is one of four things, and says which: *derived* from statistics, *measured* on
calibration draws that no published examination uses, *chosen* as what a user would call worth
saying, or *effort*, where more costs time and should change nothing.
"""

from __future__ import annotations

from dataclasses import dataclass, field, fields, replace
from typing import Any

from piezo_hysteresis.common.wording import near
from piezo_hysteresis.errors import IdentificationError
from piezo_hysteresis.identification.clock import JITTER


def number(value: float, unit: str, means: str, source: str) -> Any:
    """Return the field of a number that decides, with what is to be known of it."""
    return field(default=value, metadata={'unit': unit, 'means': means, 'source': source})


@dataclass(frozen=True)
class SelectionPolicy:
    """What decides; `POLICY` for a model that is fitted besides, `HELD` for one that is held.

    Each field has ``metadata``: ``unit``, ``means`` and ``source``; `rows` returns them all, and
    ``docs/reference/policy.md`` lists them.
    """

    # --- how far is looked ---------------------------------------------------------------
    screening_samples: int = number(
        30_000, 'samples', 'Samples to which every candidate is compared.', 'effort'
    )
    first_fit_samples: int = number(
        40_000,
        'samples',
        'Samples of trials and first fits; with fewer slow effects do not show.',
        'effort',
    )
    trials: int = number(
        10, '1', 'Candidates whose starts are tried, the most promising first.', 'effort'
    )
    first_fits: int = number(
        10,
        '1',
        'Candidates that get a first fit, those whose trials went best; as many as are tried, '
        'because some begin worse than the model without them.',
        'effort',
    )
    final_fits: int = number(
        4,
        '1',
        'Effects that get a fit to all samples; so does every variant of the best.',
        'effort',
    )
    variants_first: int = number(
        3, '1', 'Variants of one effect that come before other effects had a turn.', 'effort'
    )
    starts: int = number(2, '1', 'Starts of a first fit.', 'effort')
    trial_evaluations: int = number(
        4, '1', 'Evaluations of each start, before the best one goes on.', 'effort'
    )
    first_evaluations: int = number(16, '1', 'Evaluations of a first fit.', 'effort')
    afresh_evaluations: int = number(
        24,
        '1',
        'As many more of one that began where the baseline did, and has a longer way.',
        'effort: from there alone the right effect was behind in 4 of 22 calibration draws after '
        '16, in 2 after all 40',
    )
    first_tolerance: float = number(
        1e-4,
        '1',
        'Relative decrease of the sum of squares that counts as none in trials and first fits; of '
        'what is beyond the noise, also in fits to all samples.',
        'effort: they only rank, and what a name asks for is hundreds of times as much',
    )
    final_tolerance: float = number(
        1e-6,
        '1',
        'The same in fits to all samples, where only noise is left.',
        'effort: a tenth of a standard error where 10 000 samples count',
    )
    final_within: float = number(
        4.0,
        '1',
        'Sum of squares of a first fit, over that of the best, up to which it gets a final one; '
        'one that does not promise half of the way there is given up.',
        'effort',
    )
    promising: float = number(
        0.5,
        '1',
        'Share of what a name asks for that a first fit must have taken to get a final one, '
        'wherever one of them has.',
        'effort: final fits take up to a few hundredths more than first ones',
    )
    jitter: float = number(
        JITTER,
        'samples',
        'By how much the clock of records may be other than that of a model file, beside two of '
        'its standard deviations; never more than half a sample.',
        'chosen: what a driver that reads and writes in every tick keeps; sample numbers count '
        'whole ones, so that a whole one is a delay',
    )
    still_clock: float = number(
        1e-4,
        '1',
        'Share of a tick within which the clock of the records is where a model file says.',
        'chosen: far below what samples show',
    )
    final_evaluations: int = number(40, '1', 'Evaluations of a fit to all samples.', 'effort')
    thorough_evaluations: int = number(
        200,
        '1',
        'Evaluations of the winner, 0 for none: a fit that stops short leaves a remainder for '
        'which the next round finds a name.',
        'effort',
    )
    max_effects: int = number(5, '1', 'Effects that are looked for, one after another.', 'effort')
    min_promise: float = number(
        1e-4,
        '1',
        'Share of the squared residual that a candidate must promise to be fitted at all.',
        'effort',
    )
    promised: float = number(
        0.1,
        '1',
        'Share of what a name asks for that a candidate must promise, too.',
        'effort: what is promised near a start fell short of what a fit took by up to 4 times in '
        'calibration draws',
    )

    # --- when something is missing at all -------------------------------------------------
    negligible: float = number(
        0.03,
        '1',
        'Mean square above that of the noise, over all records, that nobody would miss.',
        'chosen: 1.5 % of the rms of the noise',
    )
    negligible_in_record: float = number(
        0.2, '1', 'The same in one record.', 'chosen: 10 % of the rms of its noise'
    )
    noise_doubts: float = number(
        3.0,
        'standard deviations',
        'How far a mean square may lie off by chance.',
        'derived: one in 740 of a normal distribution',
    )

    # --- when an effect is one ------------------------------------------------------------
    min_standard_errors: float = number(
        5.0,
        'standard errors',
        'Improvement, over what could be chance in what is left, from which it is none.',
        'derived: p of 3e-7, which 50 candidates in 5 rounds raise to 7e-5',
    )
    min_share: float = number(
        0.25,
        '1',
        'Of the excess, in mean square, that an effect must take to be worth its name; what the '
        'laws so far are known to miss is asked for besides.',
        'chosen: it lowers the gap by an eighth',
    )
    least_gap: float = number(
        0.1,
        '1',
        'Share of the gap on held-out records, in rms beyond the noise, that names must take: '
        'what takes less is no headline.',
        'derived: the rms of 50 independent numbers, as two or three held-out records hold '
        '(`octave`), is itself known to a tenth, 1/sqrt(2 * 50)',
    )
    records_information: float = number(
        200.0,
        '1',
        'Independent numbers that a record is taken to hold, by which parameters are priced '
        '(Schwarz 1978).',
        'chosen: its independent features count, not its samples; some hundred is much',
    )
    idle: float = number(
        1e-3,
        '1',
        'Share of the sum of squares below which an addition is put to the test at once.',
        'effort: it only opens the test',
    )
    needless_share: float = number(
        0.05,
        '1',
        'Share of the excess below which a simpler model is as good.',
        'chosen: a fifth of `min_share`, so that what was accepted is not dropped by noise',
    )
    better: float = number(
        0.01,
        'nats',
        'Logarithm of the sum of squares by which another effect must be better to take a place.',
        'chosen: 0.5 % of the rms',
    )
    elimination_rounds: int = number(
        3, '1', 'Times that each effect is judged again knowing the others; 0 for none.', 'effort'
    )
    restarts: int = number(
        2, '1', 'Other first effects with which the search may begin again.', 'effort'
    )
    rival_within: float = number(
        2.0,
        '1',
        'Sum of squares of another effect, over that of the winner, up to which it gets a second '
        'chance once the others are known; final fits that promise no such thing are given up.',
        'effort',
    )
    explained_gap: float = number(
        1.2,
        'noise rms',
        'Gap at which nothing more is looked for by beginning again.',
        'chosen: 44 % above the noise in mean square, the figure of the published examinations',
    )
    worse: float = number(
        0.02,
        '1',
        'Share by which the error on held-out records may grow by chance with an effect.',
        'chosen: what is refused beyond it is refused whatever training says',
    )
    resamples: int = number(
        2000, '1', 'Draws of blocks from which the share of wins is counted.', 'effort'
    )
    block_seconds: float = number(
        0.3,
        's',
        'Shortest block of whole periods that counts as one number.',
        'chosen: longer than modes and lags remember',
    )
    min_blocks: int = number(
        40,
        '1',
        'Blocks below which parts of periods count.',
        'derived: a standard error is then known to 11 %',
    )
    trust: float = number(
        0.94,
        '1',
        'Probability of a name that no other contests: laws are never quite those of an actuator, '
        'and an effect that nobody thought of looks like one that is known.',
        'measured: 46 of 49 names on simulated actuators (seed 105), held 176 of 208 on measured '
        'and foreign ones (seeds 15 to 23 and 22 to 27)',
    )
    alternative: float = number(
        0.1,
        '1',
        'Probability from which another effect is said in the same breath.',
        'chosen: one in ten is worth a word',
    )

    # --- against what a model is known to miss (the held view) ----------------------------
    news: float = number(
        1.5,
        '1',
        'Rms over what the model is known to miss under these conditions, from which it is news.',
        'measured: repeats of fitted sweeps 1.00 to 1.02, conditions in between up to 1.31',
    )
    part: float = number(
        0.1,
        '1',
        'Excess of one line or octave, over all that is known, that is news by itself.',
        'chosen: it adds a twentieth to the rms',
    )
    shape: float = number(
        0.01,
        '1',
        'Share of the known mean square that any line or octave may hold without being reported.',
        'chosen: model files tell parts from 1e-3 on, and shapes change with the drive',
    )
    octave: int = number(
        20,
        '1',
        'Independent numbers that an octave counts for at most.',
        'chosen: what a model misses is not independent from sample to sample',
    )
    line: int = number(2, '1', 'The same of a harmonic.', 'derived: a cosine and a sine')
    whole: float = number(
        3.0,
        '1',
        'Weight of the whole residual beside its parts.',
        'chosen: of two without news the nearer comes first',
    )
    price: float = number(
        2.0, 'nats', 'What each fitted parameter costs.', 'chosen: twice what Akaike 1974 asks for'
    )
    periods: float = number(
        3.0,
        'periods',
        'Length of a record from which harmonics of its drive are distinguished.',
        'chosen: lines are then three bins apart',
    )
    steady: float = number(
        0.05,
        '1',
        'Scatter of the amplitude within a record, over its mean, from which what a model misses '
        'follows the amplitude.',
        'chosen: below it a parabola has nothing to hold on to',
    )
    taper: float = number(
        0.2,
        '1',
        'Share of a record over which it is faded in and out before its spectrum is taken: slow '
        'effects are largest at the ends, which a full window would hide.',
        'chosen',
    )
    sure: float = number(
        4.0,
        'nats',
        'By how much, beside the logarithm of the number of candidates, an effect must lower the '
        'score.',
        'derived: exp(-4) is 1 in 55, in records that show news already',
    )

    def __post_init__(self) -> None:
        """Refuse numbers that cannot be meant."""
        for each in fields(self):
            value = getattr(self, each.name)
            if not isinstance(value, (int, float)) or not value >= 0:
                raise IdentificationError(
                    f'the policy number {each.name} is {value!r}: give a number that is not '
                    f'negative [{each.metadata["unit"]}]'
                )

    def but(self, **changed: float) -> SelectionPolicy:
        """Return the policy with other numbers.

        Raises
        ------
        IdentificationError
            If there is no such number, or it cannot be meant.
        """
        known = {each.name: each for each in fields(self)}
        unknown = sorted(set(changed) - set(known))
        if unknown:
            raise IdentificationError(
                f'the policy has no number {unknown[0]}{near(unknown[0], known)}: '
                f'choose one of {", ".join(known)}'
            )
        whole = {
            name: int(value) if isinstance(known[name].default, int) else float(value)
            for name, value in changed.items()
        }
        return replace(self, **whole)  # type: ignore[arg-type]


#: For a baseline that is fitted together with every effect.
POLICY = SelectionPolicy()
#: For a baseline whose file says what it misses: fits are small, and each effect has its turn.
HELD = POLICY.but(
    trust=0.85,
    trials=24,
    first_fits=24,
    final_within=16.0,
    final_fits=6,
    variants_first=1,
    max_effects=4,
    thorough_evaluations=0,
    elimination_rounds=0,
    restarts=0,
)


def rows(free: Any = POLICY, held: Any = HELD) -> list[tuple[str, str, str, str, str]]:
    """Return name, value, unit, meaning and source of every number of a policy.

    Parameters
    ----------
    free, held : dataclass of `number`
        Two presets; where they differ, the value of the second follows.
    """
    found = []
    for each in fields(free):
        first, second = getattr(free, each.name), getattr(held, each.name)
        value = f'{first:g}' if first == second else f'{first:g}; held {second:g}'
        known = each.metadata
        found.append((each.name, value, known['unit'], known['means'], known['source']))
    return found

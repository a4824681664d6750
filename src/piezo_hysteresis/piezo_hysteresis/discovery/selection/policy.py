"""Decision thresholds of discovery: name, value, unit, meaning and source.

Each value is *derived* from statistics, *measured* on calibration draws that no published test
uses, *chosen* as relevant for a user, or *effort*, where more costs time and should not change
the result.
"""

from __future__ import annotations

from dataclasses import dataclass, field, fields, replace
from typing import Any

from piezo_hysteresis.common.wording import choices
from piezo_hysteresis.errors import IdentificationError
from piezo_hysteresis.identification.simulate import JITTER


def number(value: float, unit: str, means: str, source: str) -> Any:
    """Return the field of a threshold with its unit, meaning and source."""
    return field(default=value, metadata={'unit': unit, 'means': means, 'source': source})


@dataclass(frozen=True)
class SelectionPolicy:
    """Thresholds; `POLICY` for a model that is fitted jointly, `HELD` for a fixed one.

    Each field has ``metadata``: ``unit``, ``means`` and ``source``; `rows` returns them all, and
    ``docs/reference/policy.md`` lists them.
    """

    # --- search effort ------------------------------------------------------------------
    screening_samples: int = number(
        30_000, 'samples', 'Samples on which every candidate is screened.', 'effort'
    )
    first_fit_samples: int = number(
        40_000,
        'samples',
        'Samples of trials and first fits; with fewer, slow effects do not show.',
        'effort',
    )
    trials: int = number(
        10,
        '1',
        'Candidates whose starting values are tried, best screening scores first.',
        'effort',
    )
    first_fits: int = number(
        10,
        '1',
        'Candidates with a first fit, best trials first; with a named baseline as many as trials, '
        'because some start worse than the model without them.',
        'effort',
    )
    final_fits: int = number(
        4,
        '1',
        'Effects that are fitted to all samples, with every variant of the best one.',
        'effort',
    )
    variants_first: int = number(
        3, '1', 'Variants of one effect that are tried before other effects.', 'effort'
    )
    starts: int = number(2, '1', 'Starting points of a first fit.', 'effort')
    trial_evaluations: int = number(
        4, '1', 'Evaluations of each starting point before the best one is continued.', 'effort'
    )
    first_evaluations: int = number(16, '1', 'Evaluations of a first fit.', 'effort')
    restart_evaluations: int = number(
        24,
        '1',
        'Additional evaluations of a first fit from the starting values of the baseline.',
        'effort: from there the right effect was not best in 4 of 22 calibration draws after 16 '
        'evaluations, in 2 after all 40',
    )
    first_tolerance: float = number(
        1e-4,
        '1',
        'Relative decrease of the sum of squares at which trials and first fits stop; in fits '
        'to all samples, of the part beyond the noise.',
        'effort: these fits only rank, and a significant improvement is hundreds of times as '
        'large',
    )
    final_tolerance: float = number(
        1e-6,
        '1',
        'The same in fits to all samples near the noise.',
        'effort: a tenth of a standard error with 10 000 samples',
    )
    final_within: float = number(
        4.0,
        '1',
        'Sum of squares of a first fit, relative to the best one, up to which it gets a final '
        'fit; a fit that is not expected to come half as near is terminated.',
        'effort',
    )
    promising: float = number(
        0.5,
        '1',
        'Share of the required improvement that a first fit must reach for a final fit, if one '
        'of them does.',
        'effort: final fits improve first ones by up to a few per cent',
    )
    jitter: float = number(
        JITTER,
        'samples',
        'Permitted deviation of the clock from that of a model file, in addition to two of its '
        'standard deviations; at most half a sample.',
        'chosen: a driver that reads and writes in every tick keeps this; a whole sample is a '
        'delay',
    )
    still_clock: float = number(
        1e-4,
        '1',
        'Deviation of the clock, in ticks, that counts as none.',
        'chosen: far below what samples can show',
    )
    final_evaluations: int = number(40, '1', 'Evaluations of a fit to all samples.', 'effort')
    thorough_evaluations: int = number(
        200,
        '1',
        'Additional evaluations of the winner, 0 for none: an incomplete fit leaves a residual '
        'that the next round would explain by another effect.',
        'effort',
    )
    max_effects: int = number(
        5, '1', 'Effects that are searched for, one after another.', 'effort'
    )
    min_score: float = number(
        1e-4,
        '1',
        'Share of the squared residual that a candidate must explain to first order to be fitted.',
        'effort',
    )
    required_score_share: float = number(
        0.1,
        '1',
        'Share of the required improvement that a candidate must also explain to first order.',
        'effort: first-order predictions were up to 4 times too low in calibration draws',
    )

    # --- when a residual is significant -------------------------------------------------
    negligible: float = number(
        0.03,
        '1',
        'Excess over the noise in mean square, over all records, that is negligible.',
        'chosen: 1.5 % of the rms of the noise',
    )
    negligible_in_record: float = number(
        0.2, '1', 'The same in one record.', 'chosen: 10 % of the rms of its noise'
    )
    noise_deviations: float = number(
        3.0,
        'standard deviations',
        'Random deviation of a mean square that is accepted.',
        'derived: one in 740 of a normal distribution',
    )

    # --- when an effect is significant ---------------------------------------------------
    min_standard_errors: float = number(
        5.0,
        'standard errors',
        'Improvement, relative to its standard error, that an effect needs.',
        'derived: p of 3e-7, which 50 candidates in 5 rounds raise to 7e-5',
    )
    min_share: float = number(
        0.25,
        '1',
        'Share of the excess in mean square that an effect must explain, in addition to the '
        'known discrepancy of the effects so far.',
        'chosen: it lowers the gap by an eighth',
    )
    least_gap: float = number(
        0.1,
        '1',
        'Share of the held-out gap, in rms beyond the noise or the known discrepancy, that the '
        'reported effects must remove.',
        'derived: the rms of 50 independent numbers, as two or three held-out records have '
        '(`octave`), is itself uncertain by a tenth, 1/sqrt(2 * 50)',
    )
    records_information: float = number(
        200.0,
        '1',
        'Independent numbers per record in the penalty of parameters (Schwarz 1978).',
        'chosen: independent features count, not samples; a few hundred is an upper bound',
    )
    idle: float = number(
        1e-3,
        '1',
        'Share of the sum of squares below which an addition is tested for removal at once.',
        'effort: it only starts the test',
    )
    needless_share: float = number(
        0.05,
        '1',
        'Share of the excess below which a simpler model is as good.',
        'chosen: a fifth of `min_share`, so that noise does not remove an accepted effect',
    )
    better: float = number(
        0.01,
        'nats',
        'Decrease of the logarithm of the sum of squares that another effect needs to replace '
        'one.',
        'chosen: 0.5 % of the rms',
    )
    elimination_rounds: int = number(
        3,
        '1',
        'Times that each effect is tested again with the others present; 0 for none.',
        'effort',
    )
    restarts: int = number(
        2,
        '1',
        'Restarts of the search from another first effect, and first fits that lead to a pair.',
        'effort',
    )
    alternative_within: float = number(
        2.0,
        '1',
        'Sum of squares of another effect, relative to the winner, up to which it is tried '
        'again with the others present; final fits that are not expected to reach it are '
        'terminated.',
        'effort',
    )
    explained_gap: float = number(
        1.2,
        'noise rms',
        'Held-out gap at which the search is not restarted.',
        'chosen: 44 % above the noise in mean square, the figure of the published tests',
    )
    worse: float = number(
        0.02,
        '1',
        'Random increase of the held-out error that is accepted with an effect.',
        'chosen: a larger increase rejects the effect, regardless of the fitted records',
    )
    resamples: int = number(2000, '1', 'Block-bootstrap resamples.', 'effort')
    block_seconds: float = number(
        0.3,
        's',
        'Shortest block of whole periods that counts as independent.',
        'chosen: longer than the memory of modes and lags',
    )
    min_blocks: int = number(
        40,
        '1',
        'Number of blocks below which parts of periods are used.',
        'derived: a standard error is then uncertain by 11 %',
    )
    trust: float = number(
        0.94,
        '1',
        'Probability of an uncontested name: equations do not match an actuator exactly, and an '
        'effect outside the library can resemble a known one.',
        'measured: 46 of 49 names on simulated actuators (seed 105), fixed baseline 176 of 208 '
        'on measured and independent ones (seeds 15 to 23 and 22 to 27)',
    )
    alternative: float = number(
        0.1,
        '1',
        'Probability from which another effect is reported as an alternative.',
        'chosen: one in ten is relevant',
    )

    # --- relative to the known discrepancy (fixed baseline) ----------------------------
    new_deviation: float = number(
        1.5,
        '1',
        'Rms relative to the known discrepancy under these conditions, from which a record is '
        'flagged.',
        'measured: repeats of fitted sweeps 1.00 to 1.02, conditions in between up to 1.31',
    )
    unexplained: float = number(
        1000.0,
        'noise rms',
        'Residual beyond the discrepancy in phase from which one record of a drive supports no '
        '`none`.',
        'chosen: pneumatic cylinders that were run again leave 40 to 300',
    )
    part: float = number(
        0.1,
        '1',
        'Excess of one line or octave, relative to the total expectation, that flags a record.',
        'chosen: it adds 5 % to the rms',
    )
    shape: float = number(
        0.01,
        '1',
        'Share of the known mean square of one line or octave that is not reported.',
        'chosen: model files store components from 1e-3 on, and shapes change with the drive',
    )
    octave: int = number(
        20,
        '1',
        'Largest number of independent values of an octave.',
        'chosen: model errors are correlated between samples',
    )
    line: int = number(2, '1', 'The same for a harmonic.', 'derived: a cosine and a sine')
    whole: float = number(
        3.0,
        '1',
        'Weight of the total residual relative to its components.',
        'chosen: of two models within the expectation the nearer one is ranked first',
    )
    price: float = number(
        2.0, 'nats', 'Penalty of each fitted parameter.', 'chosen: twice that of Akaike 1974'
    )
    periods: float = number(
        3.0,
        'periods',
        'Length of a record from which harmonics of its drive are resolved.',
        'chosen: lines are then three bins apart',
    )
    steady: float = number(
        0.05,
        '1',
        'Relative variation of the amplitude within a record, from which the discrepancy '
        'follows the amplitude.',
        'chosen: below it the amplitude dependence cannot be determined',
    )
    taper: float = number(
        0.2,
        '1',
        'Share of a record that is tapered before its spectrum: slow effects are largest at the '
        'ends, which a full window would suppress.',
        'chosen',
    )
    sure: float = number(
        4.0,
        'nats',
        'Decrease of the score that an effect needs, in addition to the logarithm of the number '
        'of candidates.',
        'derived: exp(-4) is 1 in 55, in records that are flagged',
    )
    chance: float = number(
        0.05,
        '1',
        'p-value from which an effect of a fixed baseline, or one of a search that its time limit '
        'ended, is not named.',
        'chosen: the usual level; of names with more than 0.001 one in seven was right (benchmark '
        'seed 7001)',
    )

    def __post_init__(self) -> None:
        """Reject invalid values."""
        for each in fields(self):
            value = getattr(self, each.name)
            if not isinstance(value, (int, float)) or not value >= 0:
                raise IdentificationError(
                    f'the policy number {each.name} is {value!r}: give a number that is not '
                    f'negative [{each.metadata["unit"]}]'
                )

    def but(self, **changed: float) -> SelectionPolicy:
        """Return a copy of the policy with changed values."""
        known = {each.name: each for each in fields(self)}
        unknown = sorted(set(changed) - set(known))
        if unknown:
            raise IdentificationError(
                f'the policy has no number {unknown[0]}{choices(unknown[0], known)}'
            )
        whole = {
            name: int(value) if isinstance(known[name].default, int) else float(value)
            for name, value in changed.items()
        }
        return replace(self, **whole)  # type: ignore[arg-type]


#: For a baseline that is fitted jointly with every effect.
POLICY = SelectionPolicy()
#: For a fixed baseline with a known discrepancy: fits are small, and each effect is tried.
HELD = POLICY.but(
    trust=0.85,
    trials=24,
    first_fits=12,
    final_within=16.0,
    final_fits=6,
    variants_first=1,
    max_effects=4,
    thorough_evaluations=0,
    elimination_rounds=0,
    restarts=0,
)


def rows(free: Any = POLICY, held: Any = HELD) -> list[tuple[str, str, str, str, str]]:
    """Return name, value, unit, meaning and source of every threshold of a policy."""
    found = []
    for each in fields(free):
        first, second = getattr(free, each.name), getattr(held, each.name)
        value = f'{first:g}' if first == second else f'{first:g}; held {second:g}'
        known = each.metadata
        found.append((each.name, value, known['unit'], known['means'], known['source']))
    return found

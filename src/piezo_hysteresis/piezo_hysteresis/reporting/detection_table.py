"""Detection limits as a table of the report and as a line of the terminal."""

from __future__ import annotations

from collections.abc import Sequence

from piezo_hysteresis.discovery.detection.limits import APART, DetectionLimit
from piezo_hysteresis.discovery.detection.statements import in_prefixes, statements
from piezo_hysteresis.models import described
from piezo_hysteresis.reporting.page import PageSection, table

_TEXT = (
    'The smallest size of each known effect that these records would have shown with a '
    'probability of 95 %, in addition to the model, and the rms change of the response at this '
    'size. A smaller effect can be present and hide in the noise, in the known discrepancy, or in '
    'fitted parameters. The better experiment lowers the limit most, with the predicted limit; '
    'without a number, no experiment of the catalogue within voltage range and slew rate of these '
    'records halves it. Limits hold for the shapes in brackets; all variants are in {file}.'
)
_APART = (
    f'Where another effect is named, its change of the response lies less than {APART:g} standard '
    'deviations away at the limit: below the size given there, these records cannot distinguish '
    'the two.'
)


def detection_section(
    limits: Sequence[DetectionLimit], file: str = 'verdict.json'
) -> PageSection | None:
    """Return the section of the report, None without detection limits."""
    if not limits:
        return None
    header = ('effect', 'detection limit', 'better experiment', 'rms change', 'similar effect')
    rows = [
        (
            each.effect,
            each.sizes + (f'; not {each.hidden}' if each.hidden not in ('', 'any') else ''),
            each.better or described(each.effect)[0].experiment,
            _range(each.displacement_m),
            each.apart,
        )
        for each in statements(limits)
    ]
    return PageSection(
        'Detection limits', f'{_TEXT.format(file=file)}\n\n{_APART}', (), (table(header, rows),)
    )


def limits_line(limits: Sequence[DetectionLimit]) -> str:
    """Return one line for the terminal: each effect with its smallest detectable sizes."""
    return '; '.join(f'{each.effect} {each.brief}' for each in statements(limits))


def _range(metres: tuple[float, float]) -> str:
    low, high = metres
    if not low < 1.2 * high or high <= 1.2 * low:
        return in_prefixes(high, 'm') if high == high else 'none'
    return f'{in_prefixes(low, "m")} to {in_prefixes(high, "m")}'

"""The C programs beside a library: an example, a self-test, a bench."""

from __future__ import annotations

from dataclasses import dataclass
from importlib.resources import files


def template(name: str) -> str:
    """Return the text of a file that is filled in."""
    return (files('piezo_hysteresis.export') / 'templates' / name).read_text('utf-8')


@dataclass(frozen=True)
class Drive:
    """The reference of the example and of the vectors.

    Attributes
    ----------
    frequency : float
        [Hz].
    amplitude, middle : float
        [m].
    gain : float
        Displacement per volt without compensation [m/V].
    centre : float
        Voltage in the middle of its range [V].
    """

    frequency: float
    amplitude: float
    middle: float
    gain: float
    centre: float


def example(name: str, drive: Drive, links: tuple[str, ...], moved: tuple[str, ...]) -> str:
    """Return the example: track a sine without, with feedforward, and with everything.

    Parameters
    ----------
    name : str
        Of the library.
    drive : Drive
        The sine.
    links : tuple of str
        Sections that can be switched off.
    moved : tuple of str
        Parameters of the plant that differ from the model, as those of an actuator do.
    """
    off = ''.join(f'        p.{link}_on = everything;\n' for link in links)
    moves = ''.join(
        f'    plant.{field} *= {1.0 + 0.002 * (-1) ** k!r};\n' for k, field in enumerate(moved)
    )
    numbers = {
        'FREQUENCY': drive.frequency, 'AMPLITUDE': drive.amplitude, 'MIDDLE': drive.middle,
        'GAIN': drive.gain, 'CENTRE': drive.centre,
    }  # fmt: skip
    text = template('example.c').replace('/*OFF*/', off).replace('/*MOVES*/', moves)
    text = text.replace('RUNS', '3' if links else '2').replace('/*ALL*/', ', '.join(links))
    for key, value in numbers.items():
        text = text.replace(f'${key}', repr(value))
    return text.replace('NAME', name).replace('UPPER', name.upper())


def selftest(name: str, stroke: float) -> str:
    """Return the self-test: vectors, and that nothing leads out of the limits."""
    text = template('selftest.c').replace('$STROKE', repr(stroke))
    return text.replace('NAME', name).replace('UPPER', name.upper())


def plant_test(name: str, stroke: float) -> str:
    """Return the self-test of a plant alone."""
    text = template('plant_selftest.c').replace('$STROKE', repr(stroke))
    return text.replace('NAME', name).replace('UPPER', name.upper())


def bench(name: str, drive: Drive) -> str:
    """Return the bench: time of single steps, and a loop by the clock."""
    text = template('bench.c').replace('$FREQUENCY', repr(drive.frequency))
    text = text.replace('$AMPLITUDE', repr(drive.amplitude)).replace('$MIDDLE', repr(drive.middle))
    return text.replace('NAME', name).replace('UPPER', name.upper())

"""The files of a library for a model, a chain of links and a target."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from piezo_hysteresis import __version__
from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.blocks.base import InterSample
from piezo_hysteresis.compensation.feedback.feedback_link import FeedbackLink
from piezo_hysteresis.compensation.harmonics.harmonic_attenuation import HarmonicAttenuation
from piezo_hysteresis.compensation.inverses.inverse_link import InverseLink
from piezo_hysteresis.compensation.limiter import EnergyLimits
from piezo_hysteresis.compensation.link import Limits, Link
from piezo_hysteresis.compensation.offline_loop import ModelPlant, closed_loop
from piezo_hysteresis.export.compensator import compensator_doors, compensator_of, plant_doors
from piezo_hysteresis.export.header import About, Component, archive, filled, header, of_model
from piezo_hysteresis.export.native import Entry, ExportError, known_target, object_code
from piezo_hysteresis.export.pieces import plant_of
from piezo_hysteresis.export.sections import (
    Section,
    inverse_section,
    limiter_section,
    limits_fields,
    section_of,
    switched,
)
from piezo_hysteresis.models.modelfile import ModelFile
from piezo_hysteresis.waveforms import Sine

#: Number of ticks of the test vectors, and duration of the smooth start of their sine [s].
_VECTORS = 4000


@dataclass(frozen=True)
class Drive:
    """The reference of the example and of the vectors."""

    frequency: float  # frequency [Hz]
    amplitude: float  # [m]
    middle: float  # centre [m]
    gain: float  # displacement per volt without compensation [m/V]
    centre: float  # voltage in the middle of its range [V]


@dataclass(frozen=True)
class Request:
    """Specification of a library."""

    name: str  # name of the library
    model: ModelFile  # model of the plant, which is also inverted
    links: Callable[[], Sequence[Link]]  # returns the chain at rest, first to last
    limits: Limits
    energy: EnergyLimits
    dt: float  # sampling interval [s]
    target: str  # one of `TARGETS`
    drive: Drive  # sine of the example and the test vectors


def files_of(asked: Request) -> dict[str, bytes | str]:
    """Return the files of a library by name."""
    known_target(asked.target)
    text = asked.model.text()
    require_rate(asked.model, asked.dt)
    digest, mark = fingerprint(text)
    model, packed, name = asked.model.model, asked.model.packed, asked.name
    links = list(asked.links())
    plant = plant_of(model, packed, asked.dt, -mark)
    chain, kinds = None, ''
    doors = plant_doors(f'{name}_plant', plant)
    if links:
        sections = _sections(asked, links, packed)
        limits = limits_fields(asked.limits, asked.energy)
        chain = compensator_of(sections, limits, asked.dt, mark)
        doors = [*compensator_doors(name, chain), *doors]
        kinds = ', '.join(each.name for each in sections)
    about = About(
        name, model.name, ' + '.join(block.name for block in model.blocks), digest,
        __version__, 1.0 / asked.dt, asked.target,
        f'The loop is {kinds}.' if links else 'The plant alone, without a compensator.',
    )  # fmt: skip
    return packaged(
        about, header(about, chain, plant), doors, text, _vectors(asked, links),
        _programs(asked, plant, chain),
    )  # fmt: skip


def fingerprint(text: str) -> tuple[str, float]:
    """Return what identifies a model file, and the mark of a state that belongs to it."""
    digest = hashlib.sha256(text.encode()).hexdigest()[:12]
    return digest, float(int(digest, 16) + 1)


def packaged(
    about: About, text: str, doors: Sequence[Entry], model: str, vectors: str,
    programs: Mapping[str, str],
) -> dict[str, bytes | str]:  # fmt: skip
    """Return the files of a library by name; `text` is its header."""
    code, name = object_code(doors, about.target), about.name
    built = ' '.join(each.removesuffix('.c') for each in programs)
    return {
        f'{name}.h': text,
        f'lib{name}.a': archive('piezo.o', code, [door.name for door in doors]),
        'Makefile': filled('Makefile.txt', name=name, programs=built),
        'CMakeLists.txt': filled(
            'CMakeLists.txt', name=name, version=about.version, programs=built
        ),
        'model.yaml': model,
        'vectors.h': vectors,
        **programs,
    }


def require_rate(model: ModelFile, dt: float) -> None:
    """Raise an error for a rate at which a discrete recursion is invalid."""
    known = model.provenance.rate
    recursions = [b.name for b in model.model.blocks if b.between is InterSample.TICK]
    if recursions and known is not None and abs(known * dt - 1.0) > 1e-9:
        raise ExportError(
            f'model {model.model.name} has {", ".join(recursions)}, a recursion that holds at '
            f'{known:g} Hz only, not at {1.0 / dt:g} Hz; give --rate {known:g}, or identify a '
            'model with a mode'
        )


def _sections(asked: Request, links: Sequence[Link], packed: FloatArray) -> list[Section]:
    fields = of_model(asked.model.model, packed, ())
    found: list[Section] = []
    for link in links:
        if isinstance(link, InverseLink) and not found:
            found.append(inverse_section(link, fields))
        elif isinstance(link, HarmonicAttenuation | FeedbackLink):
            found.append(switched(section_of(link), asked.dt))
        else:
            raise ExportError(
                f'{type(link).__name__} has no kernel and cannot be exported; choose another law'
            )
    return [*found, limiter_section(asked.limits, asked.dt)]


def _vectors(asked: Request, links: Sequence[Link]) -> str:
    """Return the outputs of links and model in Python as a C table of exact numbers."""
    drive, limits = asked.drive, asked.limits
    time = np.arange(_VECTORS, dtype=np.float64) * asked.dt
    sine = Sine(drive.amplitude, drive.frequency, _VECTORS * asked.dt, offset=drive.middle)
    samples = sine.sample(time)
    plant = ModelPlant(asked.model.model, asked.model.values, asked.dt)
    if links:
        run = closed_loop(samples, links, plant, limits, asked.dt, asked.energy)
        voltage, displacement = run.voltage, run.displacement
    else:
        voltage = drive.centre + (samples.value - drive.middle) / drive.gain
        displacement = np.array([plant.exchange(float(v)) for v in voltage])
    columns = (
        samples.value, samples.velocity, samples.acceleration, samples.frequency, samples.phase,
        voltage, displacement,
    )  # fmt: skip
    heading = 'displacement, velocity, acceleration, frequency, phase; voltage, displacement'
    return vectors_of(heading, columns)


def vectors_of(heading: str, columns: Sequence[FloatArray]) -> str:
    """Return a C table of exact numbers."""
    rows = [
        '    {' + ', '.join('NAN' if v != v else float(v).hex() for v in row) + '},'
        for row in zip(*columns, strict=True)
    ]
    first = f'static const double vectors[{len(rows)}][{len(columns)}] = {{'
    return '\n'.join([f'/* {heading} */', f'#define VECTORS {len(rows)}', first, *rows, '};', ''])


def _programs(asked: Request, plant: Component, chain: Component | None) -> dict[str, str]:
    """Return example, self-test and benchmark; of a plant alone only the self-test."""
    name, drive, stroke = asked.name, asked.drive, 2.0 * asked.drive.amplitude
    if chain is None:
        return {'selftest.c': filled('plant_selftest.c', name=name, stroke=stroke)}
    switches = tuple(
        name.removesuffix('_on')
        for name in (field.spec.name for field in chain.fields)
        if name.endswith('_on')
    )
    moved = tuple(
        field.spec.name
        for field in plant.fields[1:]
        if not field.fixed
        and field.value != 0.0
        and field.spec.low <= 0.98 * field.value <= 1.02 * field.value <= field.spec.high
        and field.spec.unit != 'Hz'
    )
    off = ''.join(f'        p.{each}_on = everything;\n' for each in switches)
    moves = ''.join(
        f'    plant.{field} *= {1.0 + 0.002 * (-1) ** k!r};\n' for k, field in enumerate(moved[:3])
    )
    return {
        'example.c': filled(
            'example.c', name=name, drive=drive, links=switches, off=off, moves=moves
        ),
        'selftest.c': filled('selftest.c', name=name, stroke=stroke),
        'bench.c': filled('bench.c', name=name, drive=drive),
    }

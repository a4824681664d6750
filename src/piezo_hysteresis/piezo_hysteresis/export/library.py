"""The files of a library for a model, a chain of links and a target."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Sequence
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
from piezo_hysteresis.export.header import (
    About,
    Component,
    Drive,
    archive,
    bench,
    cmake,
    example,
    header,
    makefile,
    of_model,
    plant_test,
    selftest,
)
from piezo_hysteresis.export.native import ExportError, known_target, object_code
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
    texts = {'model.yaml': asked.model.text()}
    require_rate(asked.model, asked.dt)
    digest = hashlib.sha256(''.join(texts.values()).encode()).hexdigest()
    model, packed, name = asked.model.model, asked.model.packed, asked.name
    links = list(asked.links())
    mark = float(int(digest[:12], 16) + 1)
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
        name, model.name, ' + '.join(block.name for block in model.blocks), digest[:12],
        __version__, 1.0 / asked.dt, asked.target,
        f'The loop is {kinds}.' if links else 'The plant alone, without a compensator.',
    )  # fmt: skip
    code = object_code(doors, asked.target)
    return {
        f'{name}.h': header(about, chain, plant),
        f'lib{name}.a': archive('piezo.o', code, [door.name for door in doors]),
        'Makefile': makefile(name, bool(links)),
        'CMakeLists.txt': cmake(name, __version__, bool(links)),
        **texts,
        'vectors.h': _vectors(asked, links),
        **_programs(asked, links, plant, chain),
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
    rows = [
        '    {' + ', '.join(float(v).hex() for v in row) + '},'
        for row in zip(*columns, strict=True)
    ]
    return '\n'.join(
        [
            '/* displacement, velocity, acceleration, frequency, phase; voltage, displacement */',
            f'#define VECTORS {len(rows)}',
            f'static const double vectors[{len(rows)}][7] = {{',
            *rows,
            '};',
            '',
        ]
    )


def _programs(
    asked: Request, links: Sequence[Link], plant: Component, chain: Component | None
) -> dict[str, str]:
    stroke = 2.0 * asked.drive.amplitude
    if chain is None:
        return {'selftest.c': plant_test(asked.name, stroke)}
    switches = tuple(
        field.name.removesuffix('_on') for field in chain.fields if field.name.endswith('_on')
    )
    moved = tuple(
        field.name
        for field in plant.fields[1:]
        if not field.fixed
        and field.value != 0.0
        and field.low <= 0.98 * field.value <= 1.02 * field.value <= field.high
        and field.unit != 'Hz'
    )
    return {
        'example.c': example(asked.name, asked.drive, switches, moved[:3]),
        'selftest.c': selftest(asked.name, stroke),
        'bench.c': bench(asked.name, asked.drive),
    }

"""The loop of several axes as a C library: decoupling, attenuation and limits in one step."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from piezo_hysteresis import __version__
from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.common.wording import counted
from piezo_hysteresis.compensation.coupled import matrix_attenuation as matrix
from piezo_hysteresis.compensation.coupled.axes_chain import AxesChain, axes_chain, axes_loop
from piezo_hysteresis.compensation.coupled.decoupling import decouple
from piezo_hysteresis.compensation.coupled.matrix_settings import MatrixSettings
from piezo_hysteresis.compensation.limiter import (
    HIGH,
    LIMITER_SIZE,
    LOW,
    STEP,
    limit,
    packed_limits,
    reset_limiter,
)
from piezo_hysteresis.compensation.link import GIVEN_SIZE, IMPOSSIBLE, OK, WATCH_SIZE, Limits
from piezo_hysteresis.export.compensator import (
    INPUT_SIZE,
    compensator_doors,
    limiter_bits,
    take_input,
)
from piezo_hysteresis.export.header import (
    UNINITIALISED,
    About,
    Component,
    Field,
    checking,
    component,
    filled,
    header,
    of_table,
)
from piezo_hysteresis.export.library import fingerprint, packaged, vectors_of
from piezo_hysteresis.export.native import known_target
from piezo_hysteresis.jit import inline_jit, scratch
from piezo_hysteresis.parameters.links import COUPLED
from piezo_hysteresis.parameters.links import VOLTAGE as VOLTAGE_TABLE
from piezo_hysteresis.waveforms import Sine

if TYPE_CHECKING:
    from piezo_hysteresis.axes.modal_model import ModalModel

# Ticks of the test vectors, and the frequency of the sine of the first axis [Hz].
_VECTORS, _FREQUENCY = 4000, 20.0
# Places in the memory, and of an axis in it: last voltage and reference.
_MARK, _TICK = range(2)
_OF_AXIS = 3  # fields: low, high, slew
_SETTINGS = 6  # numbers of a limiter


def coupled_files(
    name: str, text: str, model: ModalModel, limits: Limits, settings: MatrixSettings | None,
    target: str,
) -> dict[str, bytes | str]:  # fmt: skip
    """Return the files of a library by name; `limits` are of each axis, `text` the model file."""
    known_target(target)
    each = (limits,) * model.layout.inputs
    chain = axes_chain(model, each, settings, 1.0 / model.dt)
    digest, mark = fingerprint(text)
    axes, modes = len(each), model.layout.modes
    part = coupled_component(chain, each, mark)
    kinds = 'decoupling, attenuation' if settings is not None else 'decoupling'
    about = About(
        name, counted(axes, 'axis'), counted(modes, 'natural mode'), digest, __version__,
        1.0 / model.dt, target, f'The loop is {kinds}, limits.',
    )  # fmt: skip
    return packaged(
        about, header(about, part, None, axes), compensator_doors(name, part, axes), text,
        _vectors(chain, each),
        {'selftest.c': filled('coupled_selftest.c', name=name, axes=axes)},
    )  # fmt: skip


def coupled_fields(chain: AxesChain, limits: Sequence[Limits]) -> tuple[Field, ...]:
    """Return what may be set: the limits of each axis, and the pace and bound of corrections."""
    found = [
        of_table(VOLTAGE_TABLE, f'limits.{name}', getattr(each, name), f'axis_{i}_{name}')
        for i, each in enumerate(limits, 1)
        for name in ('low', 'high', 'slew')
    ]
    if chain.attenuation is not None:
        settings = chain.attenuation.settings
        found.append(of_table(COUPLED, 'step', settings[matrix.STEP]))
        found.append(of_table(COUPLED, 'largest_correction', settings[matrix.LARGEST]))
    return tuple(found)


def coupled_component(chain: AxesChain, limits: Sequence[Limits], mark: float) -> Component:
    """Return the kernels of a chain with its limiters; ``step(s, x, voltages)``."""
    axes, dt = len(limits), chain.model.dt
    fields = coupled_fields(chain, limits)
    law = chain.attenuation
    sizes = {
        'head': 2, 'last': 2 * axes, 'decoupling': chain.decoupling.memory.size,
        'limits': axes * (_SETTINGS + LIMITER_SIZE),
    }  # fmt: skip
    if law is not None:
        sizes |= {
            'settings': law.settings.size, 'watch': axes * WATCH_SIZE, 'lines': law.lines.size,
            'gains': law.known.size, 'guard': law.guard.size,
        }  # fmt: skip
    ends = np.cumsum(list(sizes.values()))
    first = dict(zip(sizes, (ends - list(sizes.values())).tolist(), strict=True))
    size = int(ends[-1])
    learn = _attenuating(law, first, size)
    step = _stepping(chain, axes, first, learn, mark)
    changing = _changing(fields, axes, dt, first, size, law)
    return component(step, *changing, mark, fields, tuple(sizes.items()))


def _attenuating(law: Any, first: Mapping[str, int], size: int) -> Any:
    """Return the kernel of the attenuation on the memory of the library."""
    if law is None:

        @inline_jit
        def nothing(given: FloatArray, s: FloatArray, answer: FloatArray) -> None:
            return

        return nothing
    orders, gains, attenuate = law.orders, law.gains, matrix.attenuate
    own, watch, lines = first['settings'], first['watch'], first['lines']
    known, guard = first['gains'], first['guard']

    @inline_jit
    def learn(given: FloatArray, s: FloatArray, answer: FloatArray) -> None:
        attenuate(
            given, s[own:watch], orders, gains, s[watch:lines], s[lines:known],
            s[known:guard], s[guard:size], answer,
        )  # fmt: skip

    return learn


def _stepping(
    chain: AxesChain, axes: int, first: Mapping[str, int], learn: Any, mark: float
) -> Callable[[FloatArray, FloatArray, FloatArray], int]:
    numbers = chain.decoupling.numbers
    drive, strain, rows, products = numbers.drive, numbers.strain, numbers.rows, numbers.products
    widths, powers, weights = numbers.widths, numbers.powers, numbers.weights
    strain_widths, strain_weights = numbers.strain_widths, numbers.strain_weights
    square, cube, nyquist = numbers.square, numbers.cube, 0.5 / chain.model.dt
    last, own, limiters = first['last'], first['decoupling'], first['limits']
    each = _SETTINGS + LIMITER_SIZE

    @inline_jit
    def step(s: FloatArray, x: FloatArray, voltages: FloatArray) -> int:
        if s[_MARK] != mark:
            for i in range(axes):
                voltages[i] = 0.0
            return UNINITIALISED
        given, near, answer = scratch((axes, GIVEN_SIZE)), scratch((axes, 3)), scratch(axes)
        code, before = OK, scratch(4)
        for i in range(axes):
            row, own_last = x[i * INPUT_SIZE : (i + 1) * INPUT_SIZE], last + 2 * i
            code |= take_input(row, s[_TICK], s[own_last : own_last + 2], nyquist, given[i])
            for k in range(3):
                near[i, k] = given[i, 1 + k]
        decouple(
            near, drive, strain, rows, products, widths, powers, weights, strain_widths,
            strain_weights, square, cube, s[own:limiters], answer,
        )  # fmt: skip
        learn(given, s, answer)
        for i in range(axes):
            begin = limiters + i * each
            memory = s[begin + _SETTINGS : begin + each]
            for k in range(4):
                before[k] = memory[2 + k]
            voltages[i] = limit(answer[i], memory, s[begin : begin + _SETTINGS])
            code |= limiter_bits(before, memory[2:])
            s[last + 2 * i] = voltages[i]
        s[_TICK] += 1.0
        return code

    return step


def _changing(
    fields: Sequence[Field], axes: int, dt: float, first: Mapping[str, int], size: int, law: Any
) -> tuple[Any, Any, Any, FloatArray]:
    """Return what judges and takes values, what resets a state, and the state before."""
    check, limiters, each = checking(fields), first['limits'], _SETTINGS + LIMITER_SIZE
    count = _OF_AXIS * axes
    has_law = law is not None
    own, watch = first.get('settings', 0), first.get('watch', 0)
    lines, known, guard = first.get('lines', 0), first.get('gains', 0), first.get('guard', 0)
    clear = matrix.reset_matrix

    @inline_jit
    def judge(values: FloatArray) -> int:
        code = check(values)
        for i in range(axes):
            if code == OK and not values[_OF_AXIS * i] < values[_OF_AXIS * i + 1]:
                code = IMPOSSIBLE
        return int(code)

    @inline_jit
    def take(values: FloatArray, s: FloatArray, begins: bool) -> int:
        for i in range(axes):
            at = limiters + i * each
            s[at + LOW], s[at + HIGH] = values[_OF_AXIS * i], values[_OF_AXIS * i + 1]
            s[at + STEP] = values[_OF_AXIS * i + 2] * dt
        if has_law:
            s[own + matrix.STEP] = values[count]
            s[own + matrix.LARGEST] = values[count + 1]
        return OK

    @inline_jit
    def rest(s: FloatArray) -> None:
        for k in range(_TICK, limiters):
            s[k] = 0.0
        for i in range(axes):
            at = limiters + i * each
            reset_limiter(0.0, s[at + _SETTINGS : at + each], s[at : at + _SETTINGS])
        if has_law:
            clear(s[watch:lines], s[lines:known], s[known:guard], s[guard:size])

    start = np.zeros(size)
    for i in range(axes):
        start[limiters + i * each : limiters + i * each + _SETTINGS] = packed_limits(Limits(), dt)
    if has_law:
        start[own : own + law.settings.size] = law.settings
    return judge, take, rest, start


class _Answering:
    """Displacements that are no model's: late, and a little nonlinear."""

    def __init__(self, axes: int, gain: float) -> None:
        self._before, self._gain = np.zeros(axes), gain

    def run(self, voltages: FloatArray) -> FloatArray:
        u = self._before
        self._before = voltages[0]
        return np.asarray((self._gain * (u + 0.03 * np.roll(u, 1) + 1e-3 * u**2))[None])


def _vectors(chain: AxesChain, limits: Sequence[Limits]) -> str:
    """Return inputs and voltages of a run in Python, which the self-test repeats."""
    dt, axes = chain.model.dt, len(limits)
    gain = float(1.0 / abs(chain.decoupling.numbers.drive[0]).max())
    reach = 0.3 * min(min(-each.low, each.high) for each in limits) * gain
    time = np.arange(_VECTORS, dtype=np.float64) * dt
    sines = [
        Sine(reach, _FREQUENCY * (1.0 + 0.25 * i), _VECTORS * dt, ramp=0.1).sample(time)
        for i in range(axes)
    ]
    run = axes_loop(sines, chain, _Answering(axes, gain), limits)
    measured = np.concatenate([np.full((1, axes), np.nan), run.displacement[:-1]])
    columns: list[FloatArray] = []
    for i in range(axes):
        columns += [*run.inputs[i], measured[:, i], np.ones(len(measured))]
    heading = (
        'of each axis displacement, velocity, acceleration, frequency, phase, measured, age; '
        'then voltages'
    )
    return vectors_of(heading, [*columns, *run.voltage.T])

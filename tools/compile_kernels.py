"""Compiles all kernels in advance, so that no command waits: part of set-up.

Run from the root as `tools/setup.sh` does::

    python tools/compile_kernels.py [CALL ...]

Each call of the list does briefly what commands and nodes do at length, so that every kernel is
compiled with the signatures that are really called; a test finds kernels that none reaches.
"""

from __future__ import annotations

import contextlib
import gc
import math
import multiprocessing
import os
import sys
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, Any, get_args

import numpy as np

from piezo_hysteresis.errors import PiezoError
from piezo_hysteresis.records import Record, RecordInfo

if TYPE_CHECKING:
    from piezo_hysteresis.compensation.inverses.inverse_link import InverseLink

DT = 1e-3


def plant() -> None:
    """Run a plant and change it during the run; one kernel serves all actuators and effects."""
    from piezo_sim.plant import Plant

    simulated = Plant()
    simulated.exchange(0.0)
    simulated.run(np.zeros(4))
    simulated.switch('creep')


def plants_of_axes() -> None:
    """Run the plants of several axes."""
    from piezo_sim.axes_plant import AxesPlant

    AxesPlant.from_preset('xy_scanner').run(np.zeros((4, 2)))


def blocks() -> None:
    """Let every block answer a few samples, and two side by side."""
    from piezo_hysteresis.blocks import BLOCKS
    from piezo_hysteresis.blocks.parallel import parallel_block
    from piezo_hysteresis.models.named import PARALLEL
    from piezo_hysteresis.models.simulation.compiled import kernel_of

    for block in BLOCKS.values():
        values = block.pack(block.defaults())
        block.respond(np.linspace(0.0, 1.0, 4), values, DT, state=block.initial_state(DT))
    both = parallel_block(*(BLOCKS[name] for name in PARALLEL))
    x, values, state = np.zeros(2), both.pack(both.defaults()), both.initial_state(DT)
    kernel_of(both, DT)(x, x.copy(), state, values, DT, 0.0)


def between_ticks() -> None:
    """Follow every block that has a path of its own, and chains that need one."""
    from piezo_hysteresis.blocks import BLOCKS
    from piezo_hysteresis.blocks.base import InterSample
    from piezo_hysteresis.models import Model
    from piezo_hysteresis.models.named import FOLLOWED
    from piezo_hysteresis.models.simulation.plan import LinearStage

    for block in BLOCKS.values():
        if block.path_kernel is not None:
            path, values = np.linspace(0.0, 1.0, 24), block.pack(block.defaults())
            block.path_kernel(path, path.copy(), block.initial_state(DT), values, DT, 0.0, 12)
        if block.mode is not None and block.mode.restoring is not None:
            block.mode.restoring(block.pack(block.defaults()), 1e-6, 0.0, 0.0, DT)
    for names in FOLLOWED:
        model = Model('path', tuple(BLOCKS[name] for name in names))
        late = {'delay': 0.3 * DT} if 'delay' in model.parameter_names else {}
        model.respond(np.linspace(0.0, 1.0, 4), model.pack(late), DT)
    moving = [BLOCKS[name] for name in FOLLOWED[0] if BLOCKS[name].between is InterSample.LINEAR]
    model = Model('started in motion', tuple(moving))
    (stage,) = model.stages
    assert isinstance(stage, LinearStage)
    stage.released(model.pack({})[stage.columns], DT, 4)
    stage.carried(np.zeros((1, 4)), model.pack({})[stage.columns], DT)


def derivatives() -> None:
    """Differentiate hysteresis, and chains that need a path."""
    from piezo_hysteresis.blocks import BLOCKS
    from piezo_hysteresis.blocks.base import Slot
    from piezo_hysteresis.models.named import FOLLOWED

    _differentiate((b.name,) for b in BLOCKS.values() if b.slot is Slot.HYSTERESIS)
    _differentiate(FOLLOWED)


def more_derivatives() -> None:
    """Differentiate every other block."""
    from piezo_hysteresis.blocks import BLOCKS
    from piezo_hysteresis.blocks.base import Slot

    _differentiate((b.name,) for b in BLOCKS.values() if b.slot is not Slot.HYSTERESIS)


def _differentiate(chains: Iterable[tuple[str, ...]]) -> None:
    from piezo_hysteresis.blocks import BLOCKS
    from piezo_hysteresis.identification.sensitivities import sensitivities
    from piezo_hysteresis.models import Model

    for names in chains:
        model = Model('differentiated', tuple(BLOCKS[name] for name in names))
        packed, signal = model.pack(model.defaults()), np.linspace(0.0, 1.0, 8)
        free = [q.name for q in model.parameters if not q.held]
        sensitivities(model, packed, free, signal, DT)


def fit() -> None:
    """Fit a model whose blocks have derivative kernels."""
    from piezo_hysteresis.identification import identify
    from piezo_hysteresis.identification.arx import fit_transfer_function
    from piezo_hysteresis.models import named

    identify(list(_records()), named('bouc_wen_mode'), count=1, max_evaluations=2)
    fit_transfer_function(list(_records())[:1], 1, 0, rounds=0)


def online_methods() -> None:
    """Feed every recursive method with single samples, as the node does."""
    from piezo_hysteresis.identification.online import ONLINE_METHODS, online

    for method in ONLINE_METHODS:
        recursion = online(method)
        recursion.update(0.1, 1e-6)
        recursion.update_many(np.zeros(4), np.zeros(4))
        recursion.estimate()
        recursion.free_run(np.zeros(4))


def inverses() -> None:
    """Invert every named model by every law that there is for it."""
    from piezo_hysteresis.compensation.inverses.inverse_choice import inverse_for
    from piezo_hysteresis.compensation.inverses.physical import Law, PhysicalInverse
    from piezo_hysteresis.compensation.link import INVERSES
    from piezo_hysteresis.models import NAMES, named
    from piezo_hysteresis.models.named import BANK

    values = {**named(BANK).defaults(), **named('modified').defaults()}
    ways: list[InverseLink] = [PhysicalInverse(values, DT, law=law) for law in get_args(Law)]
    for name, law in product(NAMES, INVERSES):
        if law == 'numeric' and name != 'classical':
            continue  # a kernel for each chain: those that need it are under `auto`
        model = named(name)
        with contextlib.suppress(PiezoError):  # has no such inverse
            ways.append(inverse_for(model, model.defaults(), DT, law=law))
    for inverse in ways:
        _invert(inverse)


def _invert(inverse: InverseLink) -> None:
    from piezo_hysteresis.compensation.link import ReferencePoint

    inverse.respond(np.zeros(3))
    for k in range(3):
        inverse.step(ReferencePoint(k, 1e-6 * k, 0.0, 0.0, 1.0, 0.0))


def laws() -> None:
    """Let every attenuation law take a few ticks."""
    from piezo_hysteresis.compensation.harmonics.lines import Fit, Method

    for method, fit in product(get_args(Method), get_args(Fit)):
        _attenuate(method=method, fit=fit, orders=(3,))


def _attenuate(**settings: Any) -> None:
    from piezo_hysteresis.compensation.harmonics.harmonic_attenuation import HarmonicAttenuation
    from piezo_hysteresis.compensation.harmonics.lines import AttenuationSettings
    from piezo_hysteresis.compensation.linear_gain import ModeGain
    from piezo_hysteresis.compensation.link import Measured, ReferencePoint

    gain = ModeGain(1e-6, 68.0, 0.02, DT)
    law = HarmonicAttenuation(AttenuationSettings(**settings), gain, DT)
    law.set_gain(gain)
    for k in range(700):
        point = ReferencePoint(k, 1e-6, 0.0, 0.0, 23.0, 2 * math.pi * 23.0 * k * DT)
        law.step(point, 0.0, Measured(k - 1, 0.0, 1e-9 * k))


def errors() -> None:
    """Let every law on the error take a few ticks, and change its gains."""
    from piezo_hysteresis.compensation.feedback import hinf
    from piezo_hysteresis.compensation.feedback.feedback_link import HInfinityWeights
    from piezo_hysteresis.compensation.feedback.pid import FuzzyPid, FuzzyRules, Pid, PidGains
    from piezo_hysteresis.compensation.link import Limits, Measured, ReferencePoint

    gains, rules = PidGains(1.0, 1.0, 1.0), FuzzyRules(1e-6, 1e-3, 1.0, 1.0)
    plant = hinf.transfer_function([1e-6], [2.5e-5, 1e-4, 1.0])
    found = hinf.design(plant, HInfinityWeights(bandwidth=2.0), DT)
    pid = Pid(gains, DT, limits=Limits())
    for law in (pid, FuzzyPid(gains, rules, DT), hinf.HInfinity(found.controller, DT)):
        for k in range(3):
            point = ReferencePoint(k, 1e-6, 0.0, 0.0, 23.0, 0.1 * k)
            law.step(point, 0.0, Measured(k - 1, 0.0, 1e-9 * k))
    pid.set_gains(gains)
    pid.reset()


def recorded_input() -> None:
    """Remove the noise of a recorded input."""
    from piezo_hysteresis.identification.input_error import input_error

    drive = np.where(np.arange(400) < 100, 0.0, 1.0)
    noise = 1e-3 * np.random.default_rng(0).standard_normal(drive.size)
    input_error(drive + noise, 1e-6 * drive, DT)


def limits() -> None:
    """Limit a voltage, let it go to rest, and change a model smoothly."""
    from piezo_hysteresis.compensation.inverses.inverse_choice import inverse_for
    from piezo_hysteresis.compensation.limiter import EnergyLimits, Limiter
    from piezo_hysteresis.compensation.link import CrossFade, Limits, Transition
    from piezo_hysteresis.models import named

    limiter = Limiter(Limits(), DT)
    limiter.apply(0.1)
    limiter.ramp_to(0.0, 1.0)
    Limiter(Limits(), DT, energy=EnergyLimits())
    for change in (Transition(DT), CrossFade(DT, 0.1)):
        change.apply(1.0)
        change.start()
        change.apply(0.0)
    model = named('bouc_wen_mode')
    inverse_for(model, model.defaults(), DT).set_parameters({'A': 3e-5})


def demo() -> None:
    """Track as `make demo` does, with the model that `fit` identifies."""
    from piezo_hysteresis.compensation.inverses.inverse_choice import inverse_for
    from piezo_hysteresis.models import named

    model = named('bouc_wen_mode')
    for law in ('auto', 'gain'):
        _invert(inverse_for(model, model.defaults(), DT, law=law))
    _attenuate(orders=(3,))
    limits()
    bags()


def bags() -> None:
    """Write a bag and read it."""
    from piezo_hysteresis.records import read_bag, write_bag

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / 'bag'
        write_bag(path, list(_records()))
        read_bag(path)


def screening() -> None:
    """Hold a sensitivity against others, and an error against the lines of a drive or a tone."""
    from piezo_hysteresis.numerics.harmonics import ModulatedLines, tone_amplitude, without_tone
    from piezo_hysteresis.numerics.qr import orthonormal, projected_out

    tone_amplitude(np.arange(8.0), 100.0, DT)
    without_tone(np.arange(8.0), 100.0, DT)
    projected_out(np.ones(8), orthonormal(np.eye(3, 8), 1e-6)[1:])
    ModulatedLines(np.ones((1, 8)), np.arange(8.0), 1, 1e-6).split(np.arange(8.0))


def several_axes() -> None:
    """Let modes of two axes follow a few samples of a steady state, and drive them."""
    from piezo_hysteresis.axes.axes_record import AxesRecord
    from piezo_hysteresis.axes.modal_gradient import gradient
    from piezo_hysteresis.axes.modal_model import AxesDrive, ModalLayout, ModalModel
    from piezo_hysteresis.compensation.coupled.axes_chain import AxesChain
    from piezo_hysteresis.compensation.coupled.matrix_settings import MatrixSettings
    from piezo_hysteresis.compensation.link import Measured, ReferencePoint

    layout = ModalLayout(2, 2, 1, (0.1,), (), (0.1,))
    vector, output = layout.zeros(), np.zeros((len(layout.signal_names), 2))
    u = np.sin(np.arange(32.0))[:, None] * np.ones(2)
    record = AxesRecord('rehearsal', DT, u, u, periods=1)
    model = ModalModel(layout, vector, output, 1.0, DT)
    model.simulate(record)
    drive = AxesDrive(record, layout)
    gradient(model, drive, model.signals(drive))
    output[:1] = 1e-6
    layout.named(vector)['shape'][...] = 1.0
    chain = AxesChain(model, MatrixSettings(), 1.0)
    for k in range(2):
        point, read = ReferencePoint(k, 0.0, 0.0, 0.0, 0.0, 0.0), Measured(k - 1, 0.0, 0.0)
        chain.step([point, point], [read, read])


def _records() -> Iterator[Record]:
    """Return two short records of a lagging actuator."""
    for k, frequency in enumerate((5.0, 20.0)):
        phase = np.arange(400, dtype=np.float64) * (2 * math.pi * frequency * DT)
        noise = 1e-9 * np.random.default_rng(k).standard_normal(phase.size)
        answer = 1e-6 * np.sin(phase - 0.2) + noise
        info = RecordInfo(excitation='sine', frequency=frequency, amplitude=1.0)
        yield Record(f'rehearsal {k}', DT, np.sin(phase), answer, info=info)


# Longest first, so that processes end at about the same time.
CALLS: dict[str, Callable[[], None]] = {
    call.__name__: call
    for call in (
        derivatives, inverses, more_derivatives, laws, blocks, fit, online_methods, errors,
        recorded_input, between_ticks, demo, plant, screening, several_axes, plants_of_axes,
    )
}  # fmt: skip


def run(name: str) -> tuple[str, str]:
    """Run one call; return its name and why it failed, empty if it did not."""
    try:
        CALLS[name]()
    except Exception as error:  # its kernels are compiled on first use
        return name, f'{type(error).__name__}: {error}'
    return name, ''


def collect_rarely() -> None:
    """Look for garbage less often: a compiler makes many objects that refer to each other."""
    gc.freeze()
    gc.set_threshold(100_000, 50, 100)


def main(arguments: list[str]) -> None:
    """Compile the kernels of the named calls, or of all, several at a time."""
    names = arguments or list(CALLS)
    started, live = time.perf_counter(), sys.stderr.isatty()
    workers = max(1, min(4, len(os.sched_getaffinity(0))))
    # forked: nothing has been started that a fork would break
    with multiprocessing.get_context('fork').Pool(workers, collect_rarely) as pool:
        for k, (name, failed) in enumerate(pool.imap_unordered(run, names), 1):
            if failed:
                print(f'note: {name} could not be run: {failed}', file=sys.stderr)
            if live:
                print(f'\r  kernels: {k} of {len(names)}, {name}\x1b[K', end='', file=sys.stderr)
    if live:
        print('\r\x1b[K', end='', file=sys.stderr)
    print(f'kernels compiled in {time.perf_counter() - started:.0f} s')


if __name__ == '__main__':
    main(sys.argv[1:])

"""Identification of a modal model in named steps, each kept if held-out records need it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.axes.axes_record import AxesRecord, leveled
from piezo_hysteresis.axes.frequency_response import response
from piezo_hysteresis.axes.modal_fit import ModalFit, ModalFitData
from piezo_hysteresis.axes.modal_model import ModalModel
from piezo_hysteresis.axes.modal_start import start_of
from piezo_hysteresis.common.wording import Guided, counted
from piezo_hysteresis.errors import IdentificationError
from piezo_hysteresis.identification.thread_pool import of_each
from piezo_hysteresis.numerics.linalg import failing_as, symmetric_eigen

# Half widths of plays, in levels of the largest records.
_VOLTAGE_PLAYS = (0.04, 0.3, 1.0, 3.0)
_ELONGATION_PLAYS = (0.3, 1.0, 3.0)
# Least gain of the held-out error for which an effect is kept.
LEAST_GAIN = 0.01
# Records of each level that a search fits.
_PER_LEVEL = 2
# Records with more error than the others of their level by this factor are disturbed.
_DISTURBED = 1.5
_LINEAR = ('log_omega', 'log_damping', 'shape', 'delay')
# Turns of a trial, after it, and at the end; before a round that may be the last one, in which
# slow effects are tried longer.
_TRIAL_TURNS, _TURNS, _LAST_TURNS = 2, 6, 60
_SETTLING_TURNS, _LONG_TURNS, _LONG_GAIN = 24, 8, 0.02
# Peaks of the residual response at which a mode is tried; they differ by this factor at least.
_PEAKS, _APART = 2, 1.05
_MOST_ADDED_MODES = 8


@dataclass(frozen=True)
class ModalEffect:
    """A part that a modal model may lack.

    Attributes
    ----------
    name : str
        Name of the effect.
    sentence : str
        What it is.
    parameters : tuple of str
        Its parameters.
    """

    name: str
    sentence: str
    parameters: tuple[str, ...] = ()


EFFECTS = (
    ModalEffect('voltage_hysteresis', 'plays of the voltage of each axis', ('voltage_weights',)),
    ModalEffect(
        'elongation_hysteresis',
        'plays of the elongation of each actuator act as a voltage',
        ('elongation_weights',),
    ),
    ModalEffect(
        'level_softening',
        'frequency and damping of the modes change with the mean level of the drive',
        ('softening', 'level_damping', 'level_power'),
    ),
    ModalEffect('voltage_powers', 'square and cube of the voltage', ('voltage_weights',)),
    ModalEffect('elongation_powers', 'square and cube of the elongation', ('square', 'cube')),
    ModalEffect('rate_drive', 'the rate of the voltage drives the modes', ('rate_shape',)),
)
MODE = ModalEffect('structural_mode', 'one more mode')
JOINTS = ModalEffect(
    'joint_hysteresis',
    'plays of joints, which modes stretch and no voltage drives, act as a voltage',
    ('shape', 'elongation_weights'),
)
# What a model that is kept may lack as well.
CHANGES = (
    ModalEffect('output_change', 'the displacement for each signal of the model is another one'),
    ModalEffect(
        'mode_change', 'frequency, damping and shape of the modes are others',
        ('log_omega', 'log_damping', 'shape'),
    ),
)  # fmt: skip


@dataclass(frozen=True, eq=False)
class ModalStep:
    """One step of an identification.

    Attributes
    ----------
    effect : str
        Name of the added effect; ``linear`` for the first step.
    sentence : str
        What was added.
    held_out : mapping of str to float
        Error on the held-out records by level [m].
    tried : mapping of str to float
        Held-out error of each effect that was tried in this step, relative to the one before.
    """

    effect: str
    sentence: str
    held_out: dict[str, float]
    tried: dict[str, float]


@dataclass(frozen=True, eq=False, repr=False)
class ModalIdentification(Guided):
    """Result of ``piezo_hysteresis.identify(data, 'modes')``.

    Attributes
    ----------
    model : ModalModel
        The model.
    steps : tuple of ModalStep
        How it was found.
    fitted, held_out, disturbed : tuple of str
        Names of the records that were fitted, held out, and left out as disturbed.
    """

    model: ModalModel
    steps: tuple[ModalStep, ...]
    fitted: tuple[str, ...]
    held_out: tuple[str, ...]
    disturbed: tuple[str, ...]

    def __repr__(self) -> str:
        layout = self.model.layout
        lines = [f'Modal model of {layout.inputs} axes with {counted(layout.modes, "mode")}']
        for step in self.steps:
            left = [f'{1e6 * error:.4g} µm ({level})' for level, error in step.held_out.items()]
            lines.append(f'  {step.effect}: {", ".join(left)} on held-out records')
        return '\n'.join(lines)

    def simulate(self, voltage: AxesRecord | ArrayLike) -> FloatArray:
        """Return the displacement that voltages cause, see `ModalModel.simulate`."""
        return self.model.simulate(voltage)

    def save(self, path: str | Path) -> None:
        """Write the model as YAML."""
        self.model.save(path)


def rms_error(model: ModalModel, record: AxesRecord) -> float:
    """Return the mean over the outputs of the rms free-run error [m]; a record keeps its mean."""
    return rms_left(record, model.simulate(record))


def rms_left(record: AxesRecord, simulated: FloatArray) -> float:
    """Return the error of `rms_error` of a displacement that was simulated [m]."""
    error = record.displacement - simulated
    if record.periods:
        error = error - error.mean(0)
    return float(np.sqrt(np.mean(error**2, 0)).mean())


def levels_of(records: Sequence[AxesRecord]) -> dict[str, list[AxesRecord]]:
    """Return records by level, the smallest first; stated, or by the rms of the voltage."""
    found: dict[str, list[AxesRecord]] = {}
    for each, named in zip(records, leveled(records), strict=True):
        found.setdefault(named.level, []).append(each)
    return dict(sorted(found.items(), key=lambda pair: _level(pair[1][0])))


def _level(record: AxesRecord) -> float:
    return float(np.sqrt(np.mean(record.voltage**2)))


def identify_axes(
    records: Sequence[AxesRecord],
    *,
    modes: int | None = None,
    effects: Sequence[str] | None = None,
    kept: ModalModel | None = None,
    workers: int = 1,
    report: Callable[[str], None] = lambda _: None,
    progress: Callable[[float], None] = lambda _: None,
) -> ModalIdentification:
    """Identify a modal model: linear modes first, then what held-out records need.

    Parameters
    ----------
    records : sequence of AxesRecord
        Periodic records; at least as many of each level as there are inputs, and one more. The
        last one of each level is held out.
    modes : int, optional
        Number of poles of the linear start; selected if omitted.
    effects : sequence of str, optional
        Effects to add without trials, in this order; tried one by one if omitted.
    kept : ModalModel, optional
        A model that is kept in place of linear modes: only what is added to it is fitted.
    workers : int
        Number of threads.
    report : callable
        Receives one line for each step.
    progress : callable
        Receives the finished part of the work.

    Raises
    ------
    IdentificationError
        If the records do not suffice.
    """
    unusable = IdentificationError(
        'the records do not determine the modes: drive all axes independently, over the whole band'
    )
    with failing_as(unusable):
        search = _Search(records, workers, report, progress)
        return search.run(modes, effects) if kept is None else search.beyond(kept)


class _Search:
    """Adds what lowers the held-out error most, as long as it does."""

    def __init__(
        self,
        records: Sequence[AxesRecord],
        workers: int,
        report: Callable[[str], None],
        progress: Callable[[float], None],
    ) -> None:
        levels = levels_of(records)
        self._workers, self._report, self._progress = workers, report, progress
        inputs = records[0].voltage.shape[1]
        for level, those in levels.items():
            if len(those) <= inputs:
                raise IdentificationError(
                    f'level {level} has {counted(len(those), "record")}, but '
                    f'{counted(inputs, "input")} need {inputs + 1} periodic ones, of which one is '
                    'held out; record more realisations'
                )
        self._held = {level: those[-1] for level, those in levels.items()}
        self._usable = {level: those[:-1] for level, those in levels.items()}
        self._disturbed: list[str] = []
        self._weight: dict[str, float] = {}
        self._full = max(map(_level, records))
        self._dt, self._steps = records[0].dt, 0
        self._active: dict[str, None] = dict.fromkeys(_LINEAR)

    # --- search --------------------------------------------------------------------------------

    def run(self, modes: int | None, effects: Sequence[str] | None) -> ModalIdentification:
        """Return the model and its steps."""
        model = self._linear(modes)
        steps = [self._step('linear', counted(model.layout.modes, 'linear mode'), model, {})]
        if effects is None:
            model = self._searched(model, steps, (*EFFECTS, JOINTS))
        for name in effects or ():
            effect = next((each for each in (*EFFECTS, JOINTS, MODE) if each.name == name), None)
            if effect is None:
                known = ', '.join(each.name for each in (*EFFECTS, JOINTS, MODE))
                raise IdentificationError(f'there is no effect {name}; there are {known}')
            started = (
                self._with_modes(model, 1)[0] if effect is MODE else self._with(model, effect)
            )
            started = self._tried(started, effect, _TRIAL_TURNS)
            model = self._kept(effect, started, {}, steps)
        model = self._final(model)
        steps.append(self._step('all together', 'all parameters', model, {}))
        return self._identification(model, steps)

    def _identification(
        self, model: ModalModel, steps: Sequence[ModalStep]
    ) -> ModalIdentification:
        fitted = [each.name for those in self._usable.values() for each in those]
        held = [each.name for each in self._held.values()]
        return ModalIdentification(
            model, tuple(steps), tuple(fitted), tuple(held), tuple(self._disturbed)
        )

    def beyond(self, model: ModalModel) -> ModalIdentification:
        """Return what a model lacks whose parameters are kept."""
        here = self._held[next(iter(self._held))]
        ours = here.axes, here.outputs, f'{self._dt:.6g}'
        theirs = model.layout.inputs, model.layout.outputs, f'{model.dt:.6g}'
        if ours != theirs:
            raise IdentificationError(
                f'the baseline has {counted(theirs[0], "voltage")}, '
                f'{counted(theirs[1], "displacement")}, {theirs[2]} s; the records {ours[0]}, '
                f'{ours[1]}, {ours[2]} s'
            )
        self._weigh(model)
        self._sort_out(model)
        self._active, self._full = {}, model.full_level
        steps = [self._step('baseline', 'the model that is kept', model, {})]
        effects = [CHANGES[1], *(each for each in EFFECTS if not _has(model, each))]
        refitted = self._fitted(model, (), 0)
        score = self._score(refitted) / self._score(model)
        changed = score < 1.0 - LEAST_GAIN
        # every fit finds the output matrix anew: it is named where nothing else is found
        model = self._searched(refitted if changed else model, steps, effects)
        if changed and not self._active:
            effect = CHANGES[0]
            steps.append(self._step(effect.name, effect.sentence, model, {effect.name: score}))
        if self._active:
            model = self._final(model)
        steps.append(self._step('all together', 'all that was added', model, {}))
        return self._identification(model, steps)

    def _searched(
        self, model: ModalModel, steps: list[ModalStep], effects: Sequence[ModalEffect]
    ) -> ModalModel:
        """Add effects while one lowers the held-out error more than the same turns without it."""
        left, added, settled = list(effects), 0, False
        while left or added < _MOST_ADDED_MODES:
            turns = _LONG_TURNS if settled else _TRIAL_TURNS
            candidates = [
                (each, self._with(model, each))
                for each in left
                if each is not JOINTS or 'elongation_weights' in self._active
            ]
            if added < _MOST_ADDED_MODES:
                candidates += [(MODE, each) for each in self._with_modes(model, _PEAKS)]
            without = self._fitted(model, list(self._active), turns)
            now = self._score(without)
            found = [self._tried(started, effect, turns) for effect, started in candidates]
            # where a run is no number, the effect is not one to add
            scores = np.nan_to_num([self._score(each) / now for each in found], nan=np.inf)
            tried: dict[str, float] = {}
            for (effect, _), score in zip(candidates, scores, strict=True):
                tried[effect.name] = min(float(score), tried.get(effect.name, np.inf))
            best = int(np.argmin(scores))
            if scores[best] < 1.0 - (_LONG_GAIN if settled else LEAST_GAIN):
                effect = candidates[best][0]
                model = self._kept(effect, found[best], tried, steps)
                added += effect is MODE
                left, settled = [each for each in left if each is not effect], False
            elif self._active and not settled:
                model, settled = self._fitted(without, list(self._active), _SETTLING_TURNS), True
            else:
                break
        return model

    def _kept(
        self,
        effect: ModalEffect,
        started: ModalModel,
        tried: dict[str, float],
        steps: list[ModalStep],
    ) -> ModalModel:
        """Add an effect for good."""
        self._active |= dict.fromkeys(effect.parameters)
        model = self._fitted(started, list(self._active), _TURNS)
        steps.append(self._step(effect.name, self._sentence(effect, model), model, tried))
        self._weigh(model)
        return model

    def _sentence(self, effect: ModalEffect, model: ModalModel) -> str:
        if effect is not MODE:
            return effect.sentence
        frequency = np.exp(model.parameters['log_omega'][-1]) / (2.0 * np.pi)
        return f'one more mode at {frequency:.0f} Hz'

    def _step(
        self, name: str, sentence: str, model: ModalModel, tried: dict[str, float]
    ) -> ModalStep:
        errors = dict(zip(self._held, self._errors(model, list(self._held.values())), strict=True))
        listed = ' / '.join(f'{1e6 * error:.4f}' for error in errors.values())
        self._steps += 1
        self._progress(self._steps / (self._steps + 2.0))
        self._report(f'{name}: held out {listed} um ({sentence})')
        return ModalStep(name, sentence, errors, tried)

    def _score(self, model: ModalModel) -> float:
        errors = self._errors(model, list(self._held.values()))
        weights = [self._weight[level] for level in self._held]
        return float(np.mean(np.multiply(weights, errors)))

    def _errors(self, model: ModalModel, records: Sequence[AxesRecord]) -> list[float]:
        return of_each(lambda each: rms_error(model, each), records, self._workers)

    # --- fits ----------------------------------------------------------------------------------

    def _linear(self, modes: int | None) -> ModalModel:
        """Return a linear model of all levels; sort out disturbed records by it."""
        middle = list(self._usable.values())[(len(self._usable) - 1) // 2]
        layout, vector = start_of(middle, modes)
        output = np.zeros((1, layout.outputs))
        model = ModalModel(layout, vector, output, self._full, self._dt)
        self._weight = {
            level: 1.0 / float(np.std(those[0].displacement))
            for level, those in self._usable.items()
        }
        model = self._fitted(model, _LINEAR, _TURNS)
        self._sort_out(model)
        return self._fitted(model, _LINEAR, _TURNS)

    def _sort_out(self, model: ModalModel) -> None:
        """Leave out records with more error than the others, and order the rest by it."""
        for level, those in self._usable.items():
            errors = self._errors(model, those)
            usual = float(np.median(errors))
            self._disturbed += [
                each.name
                for each, error in zip(those, errors, strict=True)
                if error > _DISTURBED * usual
            ]
            ordered = sorted(zip(errors, range(len(those)), strict=True))
            self._usable[level] = [
                those[place] for error, place in ordered if error <= _DISTURBED * usual
            ]
            self._weight[level] = 1.0 / usual

    def _final(self, model: ModalModel) -> ModalModel:
        """Return the model fitted to all records but the held-out ones, with deviations."""
        data = self._data(model, None)
        model = ModalFit(model, data, self._workers).run(list(self._active), _LAST_TURNS)
        fit = ModalFit(model, data, self._workers)
        return replace(model, deviations=fit.deviations(list(self._active)))

    def _data(self, model: ModalModel, per_level: int | None) -> ModalFitData:
        chosen = [
            (each, self._weight_of(each, level))
            for level, those in self._usable.items()
            for each in those[:per_level]
        ]
        weights = np.array([weight for _, weight in chosen])
        return ModalFitData.of([each for each, _ in chosen], model.layout, weights)

    def _weigh(self, model: ModalModel) -> None:
        """Weigh each level by what the model usually leaves of it."""
        for level, those in self._usable.items():
            errors = self._errors(model, those)
            self._weight[level] = 1.0 / float(np.median(errors))

    def _weight_of(self, record: AxesRecord, level: str) -> float:
        noise = record.noise
        known = 0.0 if noise is None else float(np.mean(noise**2)) / record.periods
        return float(1.0 / np.sqrt(self._weight[level] ** -2 + known))

    def _fitted(self, model: ModalModel, names: Sequence[str], turns: int) -> ModalModel:
        fit = ModalFit(model, self._data(model, _PER_LEVEL), self._workers)
        return (
            fit.run(names, turns) if names else fit.run(('delay',), 0)
        )  # the output matrix alone

    def _tried(self, started: ModalModel, effect: ModalEffect, turns: int) -> ModalModel:
        names = {**self._active, **dict.fromkeys(effect.parameters)}
        return self._fitted(started, list(names), turns)

    def _with(self, model: ModalModel, effect: ModalEffect) -> ModalModel:
        """Return the model with an effect of no size."""
        layout = model.layout
        if effect.name == 'voltage_hysteresis':
            layout = replace(
                layout, voltage_plays=tuple(self._full * part for part in _VOLTAGE_PLAYS)
            )
        elif effect.name == 'voltage_powers':
            layout = replace(layout, powers=(2, 3))
        elif effect.name == 'elongation_hysteresis':
            size = self._full
            layout = replace(
                layout, elongation_plays=tuple(size * part for part in _ELONGATION_PLAYS)
            )
        elif effect.name == 'elongation_powers':
            layout = replace(layout, products=True)
        elif effect is JOINTS:
            layout = replace(layout, joints=layout.inputs)
        vector = layout.carried(model.vector, model.layout)
        found = layout.named(vector)
        if effect.name == 'level_softening':
            found['softening'][0] = 0.01
        elif effect is JOINTS:  # shapes at random: at none, no slope would lead anywhere
            shapes = found['shape'][layout.inputs :]
            rng = np.random.default_rng(0)
            shapes[...] = (
                0.5 * np.std(model.parameters['shape']) * rng.standard_normal(shapes.shape)
            )
            found['elongation_weights'][:, layout.inputs :] = 0.02
        return replace(model, layout=layout, vector=vector)

    def _with_modes(self, model: ModalModel, count: int) -> list[ModalModel]:
        """Return the model with a small mode at each of the peaks of its residual's response."""
        power: FloatArray | float = 0.0
        matrices = []
        for level, those in self._usable.items():
            ran = of_each(model.simulate, those, self._workers)
            left = [
                replace(each, displacement=each.displacement - y)
                for each, y in zip(those, ran, strict=True)
            ]
            found = response(left, 4)
            matrices.append(found.matrix)
            power = power + self._weight[level] ** 2 * np.sum(np.abs(found.matrix) ** 2, (1, 2))
        inside = (found.frequency > found.frequency[-1] / 20) & (
            found.frequency < 0.97 * found.frequency[-1]
        )
        made = []
        for _ in range(count):
            peak = int(np.argmax(np.where(inside, power, 0.0)))
            ratio = found.frequency / found.frequency[peak]
            inside &= np.maximum(ratio, 1.0 / ratio) > _APART
            shape = sum(each[peak].conj().T @ each[peak] for each in matrices).real
            made.append(_with_mode(model, found.frequency[peak], np.asarray(shape)))
        return made


def _with_mode(model: ModalModel, frequency: float, shape: FloatArray) -> ModalModel:
    """Return the model with a small mode at a frequency [Hz], in the shape of a response."""
    layout = replace(model.layout, modes=model.layout.modes + 1)
    vector = layout.carried(model.vector, model.layout)
    parameters = layout.named(vector)
    parameters['log_omega'][-1] = np.log(2.0 * np.pi * frequency)
    parameters['log_damping'][-1] = np.log(0.015)
    found_shape = symmetric_eigen(shape)
    if found_shape is not None:
        parameters['shape'][: layout.inputs, -1] = 0.05 * found_shape[1][:, -1]
    parameters['softening'][:, -1] = parameters['softening'][:, :-1].mean(1)
    return replace(model, layout=layout, vector=vector)


def _has(model: ModalModel, effect: ModalEffect) -> bool:
    """Return whether a model has an effect already."""
    if effect.name in ('voltage_hysteresis', 'voltage_powers', 'elongation_hysteresis'):
        layout = model.layout
        parts = {
            'voltage_hysteresis': layout.voltage_plays, 'voltage_powers': layout.powers,
            'elongation_hysteresis': layout.elongation_plays,
        }  # fmt: skip
        return bool(parts[effect.name])
    own = [name for name in effect.parameters if name != 'level_power']
    return any(bool(np.any(model.parameters[name])) for name in own)

"""Files of modal models: YAML that a person can read."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.axes.modal_model import ModalLayout, ModalModel
from piezo_hysteresis.errors import ModelError
from piezo_hysteresis.models.modelfile import MODAL_SCHEMA
from piezo_hysteresis.models.plain import mapping, number, read_yaml, refuse_unknown, write_yaml

_PARTS = {
    'schema', 'inputs', 'outputs', 'joints', 'interval_s', 'full_level_V', 'delay_s',
    'level_power', 'modes', 'voltage', 'elongation', 'displacement', 'found',
}  # fmt: skip
_TWO_PI = 2.0 * np.pi


def save(model: ModalModel, path: str | Path) -> None:
    """Write a model."""
    write_yaml(content_of(model), path)


def content_of(model: ModalModel, found: Mapping[str, Any] | None = None) -> dict[str, Any]:
    """Return a model as plain types; `found` states how it was found."""
    layout, parameters = model.layout, model.parameters
    return {
        'schema': MODAL_SCHEMA,
        'inputs': layout.inputs,
        'outputs': layout.outputs,
        'joints': layout.joints,
        'interval_s': model.dt,
        'full_level_V': model.full_level,
        'delay_s': float(parameters['delay'][0]),
        'level_power': float(parameters['level_power'][0]),
        'modes': [_mode(model, k) for k in range(layout.modes)],
        'voltage': {
            'half_widths_V': list(layout.voltage_plays),
            'powers': list(layout.powers),
            'weights': parameters['voltage_weights'].tolist(),
        },
        'elongation': {
            'half_widths_V': list(layout.elongation_plays),
            'weights': parameters['elongation_weights'].tolist(),
            'square': parameters['square'].tolist(),
            'cube': parameters['cube'].tolist(),
            'products': layout.products,
        },
        'displacement': [
            {'of': name, 'm': row.tolist()}
            for name, row in zip(layout.signal_names, model.output, strict=True)
        ],
        **({'found': dict(found)} if found else {}),
    }


def _mode(model: ModalModel, k: int) -> dict[str, Any]:
    found = model.parameters
    omega, damping = np.exp(found['log_omega'][k]), np.exp(found['log_damping'][k])
    row: dict[str, Any] = {'frequency_Hz': float(omega / _TWO_PI), 'damping': float(damping)}
    if model.deviations is not None:
        std = model.layout.named(model.deviations)
        row['frequency_std_Hz'] = float(omega / _TWO_PI * std['log_omega'][k])
        row['damping_std'] = float(damping * std['log_damping'][k])
    for name in ('shape', 'rate_shape', 'softening', 'level_damping'):
        row[name] = found[name][:, k].tolist()
    return row


def load(path: str | Path) -> ModalModel:
    """Return the model of a file."""
    content = mapping(read_yaml(path), f'the model file {path}')
    if content.get('schema') != MODAL_SCHEMA:
        raise ModelError(
            f'{path} is no model of several axes (schema {content.get("schema")!r}); identify one '
            'with `identify DATA --model modes`'
        )
    refuse_unknown(content, _PARTS, f'the model file {path}')
    try:
        return _model(content, f'the model file {path}')
    except KeyError as error:
        raise ModelError(f'the model file {path} lacks {error.args[0]}; identify again') from None
    except (TypeError, ValueError) as error:
        raise ModelError(f'the model file {path} cannot be used: {error}') from None


def _model(content: Mapping[str, Any], what: str) -> ModalModel:
    voltage = mapping(content['voltage'], f'voltage of {what}')
    elongation = mapping(content['elongation'], f'elongation of {what}')
    modes = [mapping(each, f'a mode of {what}') for each in content['modes']]
    layout = ModalLayout(
        int(number(content['inputs'], 'inputs')),
        int(number(content['outputs'], 'outputs')),
        len(modes),
        tuple(number(each, 'a half width') for each in voltage['half_widths_V']),
        tuple(int(number(each, 'a power')) for each in voltage['powers']),
        tuple(number(each, 'a half width') for each in elongation['half_widths_V']),
        bool(elongation['products']),
        int(number(content.get('joints', 0), 'joints')),
    )
    vector = layout.zeros()
    found = layout.named(vector)
    frequency = np.array([number(each['frequency_Hz'], 'frequency_Hz') for each in modes])
    damping = np.array([number(each['damping'], 'damping') for each in modes])
    if not (frequency > 0.0).all() or not (damping > 0.0).all():
        raise ModelError(f'{what}: frequencies and damping ratios of modes must be positive')
    found['log_omega'][:], found['log_damping'][:] = np.log(_TWO_PI * frequency), np.log(damping)
    for name in ('shape', 'rate_shape', 'softening', 'level_damping'):
        _fill(found[name], np.array([each[name] for each in modes], float).T, name)
    found['delay'][0] = number(content['delay_s'], 'delay_s')
    found['level_power'][0] = number(content['level_power'], 'level_power')
    _fill(found['voltage_weights'], voltage['weights'], 'weights of the voltage')
    _fill(found['elongation_weights'], elongation['weights'], 'weights of the elongation')
    _fill(found['square'], elongation['square'], 'square')
    _fill(found['cube'], elongation['cube'], 'cube')
    output = np.empty((len(layout.signal_names), layout.outputs))
    _fill(output, [each['m'] for each in content['displacement']], 'displacement')
    model = ModalModel(
        layout, vector, output, number(content['full_level_V'], 'full_level_V'),
        number(content['interval_s'], 'interval_s'),
    )  # fmt: skip
    if not np.isfinite([*vector, *output.ravel(), model.full_level, model.dt]).all():
        raise ModelError(f'{what} holds values that are not finite numbers')
    return model


def _fill(place: FloatArray, values: object, what: str) -> None:
    array = np.asarray(values, float)
    if array.size != place.size or (array.size and array.shape != place.shape):
        raise ModelError(f'{what} has the shape {array.shape}, not {place.shape}')
    place[...] = array.reshape(place.shape)

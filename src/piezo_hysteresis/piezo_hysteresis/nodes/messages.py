"""Conversions between messages and the objects of the core; paths of requests."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from piezo_hysteresis.blocks import named_block
from piezo_hysteresis.common.recipes import RECIPES as MODELS
from piezo_hysteresis.common.wording import reason_of
from piezo_hysteresis.compensation.link import Measured, ReferencePoint
from piezo_hysteresis.errors import ModelError, PiezoError
from piezo_hysteresis.models import Model, ModelFile, named
from piezo_hysteresis.ros.cdr_header import FlatCodec
from piezo_interfaces.msg import ActuatorState, ModelEstimate, Reference, VoltageCommand
from piezo_interfaces.srv import LoadModel

if TYPE_CHECKING:
    from piezo_hysteresis.identification.recursion import Estimate


REFERENCE = FlatCodec(Reference)
STATE = FlatCodec(ActuatorState)
VOLTAGE = FlatCodec(VoltageCommand)


def point_of(payload: bytes) -> tuple[bytes, ReferencePoint]:
    """Return the head and the point of a Reference."""
    head, numbers = REFERENCE.decode(payload)
    return head, ReferencePoint._make(numbers)


def reference_bytes(head: bytes, point: ReferencePoint) -> bytes:
    """Return a Reference."""
    return head + REFERENCE.pack(*point)


def measured_of(payload: bytes) -> tuple[bytes, Measured]:
    """Return the head and the measurement of an ActuatorState."""
    head, numbers = STATE.decode(payload)
    return head, Measured._make(numbers)


def voltage_bytes(head: bytes, sample: int, voltage: float) -> bytes:
    """Return a VoltageCommand."""
    return head + VOLTAGE.pack(sample, voltage)


def estimate_into(estimate: Estimate, model: Model | None, message: ModelEstimate) -> None:
    """Write `estimate` into `message`; header, sample and method are not changed.

    Parameters of `model` that were not estimated are added with their defaults and no deviation,
    so that the message defines a complete model.
    """
    names, units = list(estimate.names), list(estimate.units)
    values = [float(value) for value in estimate.values]
    deviations = [float(value) for value in estimate.standard_deviations]
    defaults = {} if model is None else model.defaults()
    for row in () if model is None else model.parameters:
        if row.name not in names:
            names.append(row.name)
            units.append(row.unit)
            values.append(float(defaults[row.name]))
            deviations.append(0.0)
    message.model = '' if model is None else _model_name(model)
    message.names, message.units = names, units
    message.values, message.standard_deviations = values, deviations
    message.one_step_rms = float(estimate.one_step_rms)
    message.condition_number = float(estimate.condition_number)
    message.message = ' '.join(estimate.notes)


def model_from(message: ModelEstimate) -> ModelFile:
    """Return the model of `message`."""
    if not message.model:
        raise ModelError('the estimate belongs to no model; choose another method or variant')
    values = dict(zip(message.names, message.values, strict=False))
    if message.model in MODELS:
        model = named(message.model)
    else:
        model = Model('', tuple(named_block(name) for name in message.model.split(',')))
    held = {name: values[name] for name in model.held if name in values}
    return ModelFile(model.hold(**held), values)


def _model_name(model: Model) -> str:
    """Return the name of a named model, else the names of its blocks."""
    return model.name if model.name in MODELS else ','.join(block.name for block in model.blocks)


def inside(folder: str, path: str) -> Path:
    """Return `path` inside `folder`, both resolved."""
    base = Path(folder or '.').expanduser().resolve()
    try:
        target = (base / path).resolve()
        target.exists()  # raises where the name is too long
    except (OSError, ValueError) as error:
        raise PiezoError(f'{path[:40]!r} is no path: {reason_of(error)}') from None
    if not path or (target != base and base not in target.parents):
        raise PiezoError(f'{path!r} is not inside {base}: give a path below that folder')
    return target


def new_inside(folder: str, path: str) -> Path:
    """Return the new `path` inside `folder`."""
    target = inside(folder, path)
    if target.exists():
        raise PiezoError(f'{target} exists already; give another name')
    return target


def requested_model(request: LoadModel.Request, folder: str) -> ModelFile:
    """Return the model that `request` carries as text, or names by a path inside `folder`."""
    if request.yaml:
        return ModelFile.parse(request.yaml)
    return ModelFile.load(inside(folder, request.path))

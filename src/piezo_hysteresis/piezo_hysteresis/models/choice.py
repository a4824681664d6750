"""Resolves a model given by name, file, object or result."""

from __future__ import annotations

from abc import ABC, abstractmethod
from pathlib import Path
from typing import TypeAlias

from numpy.typing import ArrayLike

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.common.cached_property import cached_property
from piezo_hysteresis.errors import ModelError
from piezo_hysteresis.models.chain import Model
from piezo_hysteresis.models.model_actions import ModelActions
from piezo_hysteresis.models.modelfile import ModelFile
from piezo_hysteresis.models.named import named


class Modelled(ModelActions, ABC):
    """A result that contains a model with its values."""

    @abstractmethod
    def model_file(self) -> ModelFile:
        """Return the model with its values, deviations and provenance."""

    @cached_property
    def model(self) -> ModelFile:
        """The model with its values: a `piezo_hysteresis.Model`."""
        return self.model_file()

    def simulate(self, voltage: ArrayLike, dt: float, *, frequency: float = 0.0) -> FloatArray:
        """Return the displacement that a voltage causes, from rest; see `ModelFile.simulate`."""
        return self.model.simulate(voltage, dt, frequency=frequency)

    def save(self, path: str | Path) -> None:
        """Write the model as YAML; see `ModelFile.save`."""
        self.model.save(path)


ModelLike: TypeAlias = str | Path | Model | ModelFile | Modelled


def chosen(given: ModelLike) -> Model | ModelFile:
    """Return the model, or the model with its values, for an argument."""
    if isinstance(given, Modelled):
        return given.model
    if isinstance(given, (Model, ModelFile)):
        return given
    if not isinstance(given, (str, Path)):
        raise ModelError(
            f'a model is its name, the path of a model.yaml, a Model or the result of identify or '
            f'discover, not of type {type(given).__name__}'
        )
    if isinstance(given, Path) or given.endswith(('.yaml', '.yml')):
        return ModelFile.load(given)
    return named(given)


def with_values(given: ModelLike) -> ModelFile:
    """Return the model with its values for an argument."""
    found = chosen(given)
    if isinstance(found, Model):
        raise ModelError(
            f'model {found.name} has no values: identify it from records, or give the path of a '
            'model.yaml'
        )
    return found


def chain_of(given: ModelLike) -> tuple[Model, dict[str, float]]:
    """Return the chain for an argument, and the starting values of a fit; none for a name."""
    found = chosen(given)
    if isinstance(found, Model):
        return found, {}
    return found.model, {name: found.values[name] for name in found.model.free_names}

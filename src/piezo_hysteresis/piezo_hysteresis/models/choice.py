"""The model that a person means: by its name, by its file, or as it is."""

from __future__ import annotations

from pathlib import Path

from piezo_hysteresis.errors import ModelError
from piezo_hysteresis.models.chain import Model
from piezo_hysteresis.models.modelfile import ModelFile
from piezo_hysteresis.models.named import named


def chosen(given: str | Path | Model | ModelFile) -> Model | ModelFile:
    """Return the model, or the file with the values, that is meant.

    Parameters
    ----------
    given : str, Path, Model or ModelFile
        ``NAME[+BLOCK...]`` of a named model, or the path of a ``model.yaml``.

    Raises
    ------
    ModelError
        If there is no such model, block or file, or something else is given.
    """
    if isinstance(given, (Model, ModelFile)):
        return given
    if not isinstance(given, (str, Path)):
        raise ModelError(
            f'a model is its name, the path of a model.yaml, a Model or a ModelFile, not of type '
            f'{type(given).__name__}'
        )
    if isinstance(given, Path) or given.endswith(('.yaml', '.yml')):
        return ModelFile.load(given)
    return named(given)


def chain_of(given: str | Path | Model | ModelFile) -> tuple[Model, dict[str, float]]:
    """Return the chain that is meant, and where a fit of it starts; of a name nothing is known.

    Raises
    ------
    ModelError
        As `chosen` does.
    """
    found = chosen(given)
    if isinstance(found, Model):
        return found, {}
    return found.model, {name: found.values[name] for name in found.model.free_names}

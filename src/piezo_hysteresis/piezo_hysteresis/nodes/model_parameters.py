"""The loaded model as ROS parameters ``model.name``, ``model.chain`` and ``model.NAME``.

A parameter file sets them one after another. The model is therefore put together only when it is
asked for, at the next tick, and nobody sees it half changed.
"""

from __future__ import annotations

from collections.abc import Mapping

from piezo_common.table import ParameterSpec, ParameterTable, Value
from piezo_hysteresis.blocks import named_block
from piezo_hysteresis.errors import PiezoError
from piezo_hysteresis.models import Model, ModelFile
from piezo_ros_common.parameters import NodeParameters

PREFIX = 'model.'

HEAD = ParameterTable(
    (
        ParameterSpec('model.name', '', 'Name of the loaded model; empty where there is none.'),
        ParameterSpec('model.chain', [''], 'Names of its blocks, from voltage to displacement.'),
        ParameterSpec('model.held', [''], 'Parameters that were not fitted.'),
        ParameterSpec(
            'model.noise_floor', 0.0, 'Noise of the data it was fitted to; 0 not known.', 'm', 0.0
        ),
        ParameterSpec(
            'model.sampling_offset',
            0.0,
            'By how much later than the convention those data were sampled; 0 not known.',
            's',
            -1.0,
            1.0,
        ),
    )
)


def model_table(model: Model, values: Mapping[str, float]) -> ParameterTable:
    """Return a row for every parameter of `model`, with `values` as defaults."""
    return ParameterTable(
        tuple(
            ParameterSpec(
                PREFIX + row.name,
                float(values[row.name]),
                row.description,
                row.unit,
                row.low,
                row.high,
            )
            for row in model.parameters
        )
    )


class ModelParameters:
    """Keeps ``model.*`` in step with whatever model is loaded.

    Parameters
    ----------
    parameters : NodeParameters
        Of the node.
    """

    def __init__(self, parameters: NodeParameters) -> None:
        self._parameters = parameters
        self._table: ParameterTable | None = None
        self._chain: list[str] = []
        self._changed = False
        parameters.extend(HEAD, self._head_changed, self._refuse_head)
        self._follow_chain()

    def load(self, loaded: ModelFile) -> None:
        """Make `loaded` the model of the node."""
        values = loaded.to_ros_parameters()
        head = {spec.name: values[spec.name] for spec in HEAD.specs}
        self._parameters.overwrite(head)
        self._parameters.overwrite({k: v for k, v in values.items() if k not in head})
        self._changed = True

    def take(self) -> ModelFile | None:
        """Return the model where it changed since the last call, else None.

        Raises
        ------
        PiezoError
            If the parameters do not make a model; the old one should then stay in force.
        """
        if not self._changed:
            return None
        self._changed = False
        if not self._chain:
            return None
        values = self._parameters.values
        return ModelFile.from_ros_parameters(
            {name: value for name, value in values.items() if name.startswith(PREFIX)}
        )

    def _refuse_head(self, changes: dict[str, Value]) -> str:
        if 'model.chain' not in changes:
            return ''
        names = changes['model.chain']
        assert isinstance(names, list)
        try:
            Model('', tuple(named_block(str(name)) for name in names if name))
        except PiezoError as error:
            return f'model.chain: {error}; see docs/models.md'
        return ''

    def _head_changed(self, changes: dict[str, Value]) -> None:
        self._changed = True
        if 'model.chain' in changes:
            self._follow_chain()

    def _follow_chain(self) -> None:
        named = self._parameters.values['model.chain']
        assert isinstance(named, list)
        chain = [str(name) for name in named if name]
        if chain == self._chain:
            return
        if self._table is not None:
            self._parameters.drop(self._table)
            self._table = None
        self._chain = chain
        if chain:
            model = Model('', tuple(named_block(name) for name in chain))
            self._table = model_table(model, model.defaults())
            self._parameters.extend(self._table, self._value_changed)
        self._changed = True

    def _value_changed(self, _: dict[str, Value]) -> None:
        self._changed = True

"""The loaded model as ROS parameters ``model.name``, ``model.chain`` and ``model.NAME``.

A parameter file sets them one after another. The model is therefore built only once all parameters
of a request are set, so that no inconsistent model is used. An unusable value is refused, or
reverted if it was set together with others: the parameters show the model in use.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

from piezo_hysteresis.blocks import named_block
from piezo_hysteresis.common.parameter_table import ParameterSpec, ParameterTable, Value
from piezo_hysteresis.errors import ModelError, PiezoError
from piezo_hysteresis.models import Model, ModelFile
from piezo_hysteresis.ros.guarded import Guarded
from piezo_hysteresis.ros.parameters import NodeParameters

PREFIX = 'model.'
PER_DRIVE = (
    'the model has a set of parameters per drive, and model.* are none of them; load a changed '
    'model file'
)

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
    """Keeps ``model.*`` consistent with the model that a node uses."""

    def __init__(
        self,
        node: Guarded,
        parameters: NodeParameters,
        use: Callable[[ModelFile], None],
        refusal: Callable[[ModelFile], str] = lambda _: '',
    ) -> None:
        self._node, self._parameters = node, parameters
        self._use, self._refusal = use, refusal
        self._used: ModelFile | None = None
        self._table: ParameterTable | None = None
        self._chain: list[str] = []
        self._changed = False
        parameters.extend(HEAD, self._head_changed, self._refuse_head)
        self._follow_chain()

    def load(self, loaded: ModelFile) -> None:
        """Make `loaded` the model of the node."""
        self._write(loaded)
        self.follow(loaded)

    def follow(self, given: ModelFile | None = None) -> None:
        """Use the model that the parameters describe, if they have changed.

        A model given as a file is used unchanged: the parameters contain only its values.
        """
        if not self._changed:
            return
        self._changed = False
        if not self._chain:
            return
        try:
            loaded = self._described({})
            if given is not None and given.values == loaded.values:
                loaded = given
            elif given is None:
                loaded = self._with_schedule(loaded)
            self._use(loaded)
        except PiezoError:
            if self._used is not None:
                self._write(self._used)
                self._changed = False
            raise
        self._used = loaded

    def _with_schedule(self, loaded: ModelFile) -> ModelFile:
        """Return the described model with the schedule in use, which has no parameters."""
        used = self._used
        if (
            used is None
            or used.schedule is None
            or used.model.block_names != loaded.model.block_names
        ):
            return loaded
        if used.values != loaded.values:
            raise ModelError(PER_DRIVE)
        return replace(loaded, schedule=used.schedule)

    def _described(self, changes: Mapping[str, Value]) -> ModelFile:
        values = {**self._parameters.values, **changes}
        return ModelFile.from_ros_parameters(
            {name: value for name, value in values.items() if name.startswith(PREFIX)}
        )

    def _write(self, loaded: ModelFile) -> None:
        values = loaded.to_ros_parameters()
        head = {spec.name: values[spec.name] for spec in HEAD.specs}
        self._parameters.overwrite(head)
        self._parameters.overwrite({k: v for k, v in values.items() if k not in head})
        self._changed = True

    def _change(self) -> None:
        """Update once all parameters of the request are set."""
        if not self._changed:
            self._node.run_later(self._follow_later)
        self._changed = True

    def _follow_later(self) -> None:
        try:
            self.follow()
        except PiezoError as error:
            self._node.get_logger().error(f'{error} (the previous model remains active)')

    def _refuse_values(self, changes: dict[str, Value]) -> str:
        if self._changed:  # more parameters may follow
            return ''
        if self._used is not None and self._used.schedule is not None:
            return PER_DRIVE
        try:
            return self._refusal(self._described(changes))
        except PiezoError as error:
            return str(error)

    def _refuse_head(self, changes: dict[str, Value]) -> str:
        if 'model.chain' not in changes:
            return ''
        names = changes['model.chain']
        assert isinstance(names, list)
        if self._used is not None and not any(names):
            return 'model.chain: a model is in use; load another one in its place'
        try:
            Model('', tuple(named_block(str(name)) for name in names if name))
        except PiezoError as error:
            return f'model.chain: {error}; see docs/models.md'
        return ''

    def _head_changed(self, changes: dict[str, Value]) -> None:
        self._change()
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
        self._change()  # the values are set after the chain
        if chain:
            model = Model('', tuple(named_block(name) for name in chain))
            self._table = model_table(model, model.defaults())
            self._parameters.extend(self._table, self._value_changed, self._refuse_values)

    def _value_changed(self, _: dict[str, Value]) -> None:
        self._change()

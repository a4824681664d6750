"""Declares a parameter table on a node: validate first, apply only after acceptance."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass

from rcl_interfaces.msg import (
    FloatingPointRange,
    IntegerRange,
    ParameterDescriptor,
    SetParametersResult,
)
from rclpy.exceptions import (
    InvalidParameterTypeException,
    InvalidParameterValueException,
    ParameterNotDeclaredException,
)
from rclpy.node import Node
from rclpy.parameter import Parameter

from piezo_hysteresis.common.parameter_table import ParameterSpec, ParameterTable, Value
from piezo_hysteresis.ros.starting import refuse_start

Apply = Callable[[dict[str, Value]], None]
Refuse = Callable[[dict[str, Value]], str]

LARGEST = 1.7976931348623157e308
ARRAYS = {
    bool: Parameter.Type.BOOL_ARRAY,
    int: Parameter.Type.INTEGER_ARRAY,
    float: Parameter.Type.DOUBLE_ARRAY,
    str: Parameter.Type.STRING_ARRAY,
}


class RefusedError(ParameterNotDeclaredException):
    """A value that the table rejects, with the reason of the table.

    rclpy checks the descriptor before it calls a node, and reports a range without its unit and a
    type by its number. An exception raised before that check takes precedence; the services of
    rclpy return only exceptions of the base class.
    """

    def __init__(self, reason: str) -> None:
        Exception.__init__(self, reason)


@dataclass(frozen=True)
class _Group:
    """Rows that are validated and applied together."""

    table: ParameterTable
    apply: Apply
    refuse: Refuse | None


class NodeParameters:
    """The parameters of a node: declared from a table, validated on merged values, then applied.

    A node calls `serve` once the objects that its callbacks use exist; before that, only the table
    validates.
    """

    def __init__(self, node: Node, table: ParameterTable) -> None:
        self._node = node
        self._groups: list[_Group] = []
        self.values: dict[str, Value] = {}
        self._given: set[str] = set()
        self.extend(table, lambda _: None)
        node.add_pre_set_parameters_callback(self._coerce)
        node.add_on_set_parameters_callback(self._judge)
        node.add_post_set_parameters_callback(self._accept)

    def serve(self, apply: Apply, refuse: Refuse | None = None) -> None:
        """Validate the present values by the node, and call the node on every further change."""
        table = self._groups[0].table
        own = {spec.name: self.values[spec.name] for spec in table.specs}
        reason = '' if refuse is None else refuse(own)
        if reason:
            refuse_start(reason)
        self._groups[0] = _Group(table, apply, refuse)

    def extend(self, table: ParameterTable, apply: Apply, refuse: Refuse | None = None) -> None:
        """Declare further rows, for parts that are known only once the node runs."""
        values = {spec.name: self._declare_one(spec) for spec in table.specs}
        reason = table.judge(values, values)
        if not reason and refuse is not None:
            reason = refuse(values)
        if reason:
            refuse_start(reason)
        self.values.update(values)
        self._groups.append(_Group(table, apply, refuse))

    def drop(self, table: ParameterTable) -> None:
        """Undeclare the rows of `table`."""
        self._groups = [group for group in self._groups if group.table is not table]
        for spec in table.specs:
            self._node.undeclare_parameter(spec.name)
            del self.values[spec.name]

    def overwrite(self, values: Mapping[str, Value]) -> str:
        """Set several parameters at once from within the node; return '' or why it is refused."""
        parameters = [Parameter(name, value=value) for name, value in values.items()]
        try:
            result = self._node.set_parameters_atomically(parameters)
        except RefusedError as refused:
            return str(refused)
        return '' if result.successful else str(result.reason)

    def is_given(self, name: str) -> bool:
        """Return whether a parameter that a model file may set was set by the user at start."""
        return name in self._given

    def __getitem__(self, name: str) -> Value:
        return self.values[name]

    def number(self, name: str) -> float:
        """Return a float or int parameter as a float."""
        value = self.values[name]
        assert isinstance(value, int | float)
        return float(value)

    def integer(self, name: str) -> int:
        """Return an int parameter."""
        value = self.values[name]
        assert isinstance(value, int)
        return value

    def text(self, name: str) -> str:
        """Return a str parameter."""
        value = self.values[name]
        assert isinstance(value, str)
        return value

    def flag(self, name: str) -> bool:
        """Return a bool parameter."""
        value = self.values[name]
        assert isinstance(value, bool)
        return value

    def numbers(self, name: str) -> list[float]:
        """Return a list of floats."""
        value = self.values[name]
        assert isinstance(value, list)
        return [float(each) for each in value]

    def _spec(self, name: str) -> ParameterSpec | None:
        found = (group.table.spec(name) for group in self._groups)
        return next((spec for spec in found if spec is not None), None)

    def _declare_one(self, spec: ParameterSpec) -> Value:
        descriptor = describe(spec)
        if spec.from_model and self._override(spec.name) is not None:
            self._given.add(spec.name)
        try:
            found = self._node.declare_parameter(spec.name, spec.default, descriptor).value
        except InvalidParameterTypeException:
            found = self._declare_converted(spec, descriptor)
        except (InvalidParameterValueException, ValueError) as error:
            reason = ' '.join(str(error).split())
            refuse_start(f'{spec.name}: {reason}; allowed is {spec.range_text()}')
        if found is None and isinstance(spec.default, list):
            found = self._declare_empty(spec, descriptor)
        return list(found) if isinstance(spec.default, list) else found

    def _declare_empty(self, spec: ParameterSpec, descriptor: ParameterDescriptor) -> Value:
        # An empty list of a parameter file or argument has no type.
        self._node.undeclare_parameter(spec.name)
        self._node.declare_parameter(spec.name, spec.default, descriptor, ignore_override=True)
        empty = Parameter(spec.name, ARRAYS[spec.element], [])
        result = self._node.set_parameters([empty])[0]
        if not result.successful:
            refuse_start(f'{spec.name}: {result.reason}')
        return []

    def _declare_converted(self, spec: ParameterSpec, descriptor: ParameterDescriptor) -> Value:
        # A parameter file has 5 for a float: it is read untyped, then declared as 5.0.
        value = spec.coerce(self._override(spec.name))
        reason = spec.judge(value)
        if reason:
            refuse_start(reason)
        declared = self._node.declare_parameter(spec.name, value, descriptor, ignore_override=True)
        result: Value = declared.value
        return result

    def _override(self, name: str) -> object:
        """Return what a parameter file or argument gives for an undeclared parameter, or None."""
        loose = ParameterDescriptor(dynamic_typing=True)
        given: object = self._node.declare_parameter(name, None, loose).value
        self._node.undeclare_parameter(name)
        return given

    def _coerce(self, parameters: list[Parameter]) -> list[Parameter]:
        coerced = []
        for parameter in parameters:
            spec = self._spec(parameter.name)
            if spec is None and not self._node.has_parameter(parameter.name):
                # Logged here because rclpy omits the name.
                raise ParameterNotDeclaredException(parameter.name)
            coerced.append(parameter if spec is None else self._allowed(parameter, spec))
        return coerced

    def _allowed(self, parameter: Parameter, spec: ParameterSpec) -> Parameter:
        meant = _meant(parameter, spec)
        reason = '' if spec.read_only else spec.judge(meant.value)
        if reason:
            raise RefusedError(reason)
        return meant

    def _judge(self, parameters: list[Parameter]) -> SetParametersResult:
        changes = {parameter.name: _plain(parameter.value) for parameter in parameters}
        reasons = (self._judge_group(group, changes) for group in self._groups)
        reason = next((reason for reason in reasons if reason), '')
        return SetParametersResult(successful=not reason, reason=reason)

    def _judge_group(self, group: _Group, changes: dict[str, Value]) -> str:
        own = _own(group, changes)
        if not own:
            return ''
        reason = group.table.judge(self.values, own)
        return reason or (group.refuse(own) if group.refuse is not None else '')

    def _accept(self, parameters: list[Parameter]) -> None:
        changes = {parameter.name: _plain(parameter.value) for parameter in parameters}
        for group in self._groups:
            own = _own(group, changes)
            if own:
                self.values.update(own)
                group.apply(own)


def _meant(parameter: Parameter, spec: ParameterSpec) -> Parameter:
    """Return a parameter as its row means it."""
    value = spec.coerce(parameter.value)
    if isinstance(spec.default, list) and _is_empty(value):
        # an empty list has no type: `ros2 param set` sends one of bool
        return Parameter(parameter.name, ARRAYS[spec.element], [])
    return parameter if value is parameter.value else Parameter(parameter.name, value=value)


def _is_empty(value: object) -> bool:
    return not isinstance(value, str) and hasattr(value, '__len__') and len(value) == 0


def _own(group: _Group, changes: dict[str, Value]) -> dict[str, Value]:
    return {name: value for name, value in changes.items() if group.table.spec(name) is not None}


def _plain(value: object) -> Value:
    if isinstance(value, bool | int | float | str):
        return value
    return list(value)  # type: ignore[call-overload, no-any-return]


def describe(spec: ParameterSpec) -> ParameterDescriptor:
    """Return the ROS descriptor of a row: description, unit and range."""
    unit = f' [{spec.unit}]' if spec.unit else ''
    choices = f' One of {", ".join(spec.choices)}.' if spec.choices else ''
    descriptor = ParameterDescriptor(
        description=f'{spec.description}{unit}{choices}', read_only=spec.read_only
    )
    if spec.choices:
        descriptor.additional_constraints = f'one of {", ".join(spec.choices)}'
    if type(spec.default) is float:
        low = max(spec.low, spec.above, -LARGEST)
        high = min(spec.high, LARGEST)
        descriptor.floating_point_range = [FloatingPointRange(from_value=low, to_value=high)]
    elif type(spec.default) is int and math.isfinite(spec.low) and math.isfinite(spec.high):
        descriptor.integer_range = [
            IntegerRange(from_value=int(spec.low), to_value=int(spec.high), step=1)
        ]
    return descriptor

"""What `ros2 param set` makes of a typed text reaches the node as it was meant."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
import rclpy
from rclpy.node import Node
from rclpy.parameter import Parameter, get_parameter_value

from piezo_hysteresis.common.parameter_table import ParameterSpec, ParameterTable
from piezo_hysteresis.ros.parameters import NodeParameters, RefusedError
from piezo_hysteresis.runtime.sweep_plan import parse_options

pytestmark = pytest.mark.ros

TABLE = ParameterTable(
    (
        ParameterSpec('orders', [1, 3], 'Orders.', '1', 0, 9),
        ParameterSpec('gains', [1.5], 'Gains.', 'V', 0.0, 9.0),
        ParameterSpec('names', ['a'], 'Names.'),
        ParameterSpec('share', 0.5, 'Share.', '1', 0.0, 1.0),
        ParameterSpec('stroke', 1e-4, 'Stroke.', 'm', high=0.01, above=0.0),
        ParameterSpec('options', '', 'YAML.'),
    )
)


@pytest.fixture
def context() -> Iterator[rclpy.Context]:
    found = rclpy.Context()
    rclpy.init(context=found, domain_id=66)
    yield found
    rclpy.shutdown(context=found)


def new_node(context: rclpy.Context, *given: str) -> tuple[Node, NodeParameters]:
    words = ['--ros-args', *(word for each in given for word in ('-p', each))] if given else []
    node = Node('texts', context=context, cli_args=words, start_parameter_services=False)
    return node, NodeParameters(node, TABLE)


def typed(node: Node, name: str, text: str) -> str:
    """Set a parameter as `ros2 param set` does; return the refusal."""
    message = Parameter(name, value=0).to_parameter_msg()
    message.value = get_parameter_value(text)
    try:
        return str(node.set_parameters([Parameter.from_parameter_msg(message)])[0].reason)
    except RefusedError as refused:  # as the service of rclpy does
        return str(refused)


@pytest.mark.parametrize(
    ('name', 'text', 'meant'),
    [
        ('orders', '[]', []),
        ('gains', '[]', []),
        ('names', '[]', []),
        ('gains', '[1, 2.5]', [1.0, 2.5]),
        ('gains', '[1, 2]', [1.0, 2.0]),
        ('share', '5e-1', 0.5),
        ('orders', '[0, 2]', [0, 2]),
    ],
)
def test_a_typed_value_is_what_it_means(
    context: rclpy.Context, name: str, text: str, meant: object
) -> None:
    node, parameters = new_node(context)
    assert typed(node, name, text) == ''
    assert parameters[name] == meant
    node.destroy_node()


def test_typed_yaml_reaches_the_node_as_yaml(context: rclpy.Context) -> None:
    node, parameters = new_node(context)
    # in two pairs of quotes, as docs say: of a bare mapping `ros2 param set` makes no text
    assert typed(node, 'options', "'{seed: 3}'") == ''
    assert parse_options(parameters.text('options')) == {'seed': 3}
    node.destroy_node()


@pytest.mark.parametrize(
    ('name', 'text', 'reason'),
    [
        ('orders', '[1, 20]', 'orders = 20 is outside 0 .. 9'),
        ('gains', '[1.0, 20.0]', 'gains = 20 V is outside 0 .. 9 V'),
        ('share', '2', 'share = 2 is outside 0 .. 1'),
        ('stroke', '2', 'stroke = 2 m is outside its range, above 0 .. 0.01 m'),
        ('share', 'half', "share must be of type float, got 'half'; write for example 0.5"),
        ('orders', '[1, 2.5]', 'orders'),
        ('gains', 'none', 'gains'),
    ],
)
def test_a_refusal_has_a_unit_or_none(
    context: rclpy.Context, name: str, text: str, reason: str
) -> None:
    node, parameters = new_node(context)
    before = parameters[name]
    said = typed(node, name, text)
    assert said == reason if ' ' in reason else said
    assert parameters[name] == before
    node.destroy_node()


def test_an_empty_list_may_be_given_at_the_start(context: rclpy.Context) -> None:
    node, parameters = new_node(context, 'orders:=[]', 'gains:=[]')
    assert parameters['orders'] == []
    assert parameters['gains'] == []
    assert typed(node, 'orders', '[3]') == ''
    assert parameters['orders'] == [3]
    node.destroy_node()

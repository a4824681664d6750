"""Numbers of any type become floats before a message is sent."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip('rclpy', reason='the workspace is not built: run "make setup"')

from piezo_hysteresis.nodes.messages import STATE
from piezo_hysteresis.ros.cdr_header import head_of, with_floats


class Message:
    """Holds what is assigned, as messages of rclpy do under ``python -O``."""

    def __init__(self, **values: object) -> None:
        self.__dict__.update(values)

    @staticmethod
    def get_fields_and_field_types() -> dict[str, str]:
        return {'voltage': 'double', 'values': 'sequence<double>', 'sample': 'uint64'}


@pytest.mark.parametrize('number', [1, -1, np.float32(2.5), np.int64(3), np.float64(0.5), True])
def test_every_number_becomes_a_float(number: float) -> None:
    message = with_floats(Message(voltage=number, values=[number, 2], sample=7))
    assert type(message.voltage) is float
    assert message.voltage == number
    assert [type(each) for each in message.values] == [float, float]
    assert message.values == [number, 2.0]
    assert message.sample == 7
    payload = head_of(1, 2) + STATE.pack(7, number, number)
    assert STATE.decode(payload)[1] == (7, float(number), float(number))

"""The client nv200 of piezosystem jena: print the responses, as one line of JSON."""

from __future__ import annotations

import asyncio
import json
import sys
from typing import Any

import numpy as np
from nv200.data_recorder import DataRecorder, DataRecorderSource, RecorderAutoStartMode
from nv200.nv200_device import NV200Device
from nv200.serial_protocol import SerialProtocol
from nv200.shared_types import StatusFlags
from nv200.telnet_protocol import TelnetProtocol
from nv200.waveform_generator import WaveformGenerator, WaveformUnit


async def responses(place: str) -> dict[str, Any]:
    """Move, play two cycles of a wave and read the recorder, then close the loop.

    The `place` is a serial port, or ``HOST:PORT`` of a telnet server.
    """
    host, colon, port = place.rpartition(':')
    made = NV200Device(TelnetProtocol(host, int(port)) if colon else SerialProtocol(place))
    await made.connect(False)
    found: dict[str, Any] = {
        'range': await made.get_voltage_range(),
        'unit': await made.get_position_unit(),
        'has_sensor': await made.has_position_sensor(),
        'is_closed': (await made.get_status_register()).has_flag(StatusFlags.CLOSED_LOOP_MODE),
        'settings': len(await made.backup_actuator_config()),
    }
    await made.move_to_voltage(1.5)
    recorder, generator = DataRecorder(made), WaveformGenerator(made)
    voltage = await recorder.read_single_value_from(DataRecorderSource.PIEZO_VOLTAGE)
    found['voltage'] = voltage
    wave = generator.generate_sine_wave(50, low_level=0.0, high_level=3.0)
    await generator.set_waveform(wave, unit=WaveformUnit.VOLTAGE)
    await recorder.set_data_source(0, DataRecorderSource.PIEZO_POSITION)
    await recorder.set_data_source(1, DataRecorderSource.PIEZO_VOLTAGE)
    await recorder.set_autostart_mode(RecorderAutoStartMode.START_ON_WAVEFORM_GEN_RUN)
    await recorder.set_recording_duration_ms(wave.cycle_time_ms * 2)
    await generator.start(cycles=2, start_index=0)
    await generator.wait_until_finished()
    await recorder.wait_until_finished()
    played = np.array((await recorder.read_recorded_data())[1].values)
    planned = np.array(wave.values)
    found['off'] = float(np.abs(played[: planned.size] - planned).max())
    await generator.stop()
    await made.pid.set_closed_loop(True)
    await made.move_to_position(20.0)
    for _ in range(60):
        await asyncio.sleep(0.05)
        found['position'] = await made.get_current_position()
    await made.close()
    return found


if __name__ == '__main__':
    print(json.dumps(asyncio.run(responses(sys.argv[1])), default=str), flush=True)

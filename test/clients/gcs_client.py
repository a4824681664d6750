"""PIPython on a GCS controller: print the responses, as one line of JSON."""

from __future__ import annotations

import json
import sys
import time
from typing import Any

import numpy as np
from pipython import GCSDevice
from pipython.pidevice.interfaces.pisocket import PISocket

UPDATE_TIME = 0x0E000200


def responses(port: int) -> dict[str, Any]:
    """Play a wave of 500 points and read the recorder, then close the loop."""
    made = GCSDevice(gateway=PISocket('127.0.0.1', port))
    found: dict[str, Any] = {
        'axes': made.axes,
        'range': [made.qVMI()[1], made.qVMA()[1]],
        'period': made.qSPA('1', UPDATE_TIME)['1'][UPDATE_TIME],
        'records': made.HasqDRR(),
        'generators': made.qTWG(),
        'travel': [made.qTMN()['1'], made.qTMX()['1']],
        'options': made.qHDR(),
        'unit': made.qPUN()['1'],
    }
    made.SVO('1', 0)
    wave = np.concatenate([np.sin(np.arange(499) * np.pi / 499), [0.0]])
    made.WAV_PNT(table=1, firstpoint=1, numpoints=500, append='X', wavepoint=list(wave))
    made.WSL(1, 1)
    made.WGC(1, 1)
    made.WTR(1, 1, 0)
    made.DRC(1, '1', 2)
    made.DRC(2, '1', 7)
    found['recorded'] = [made.qDRC(1), made.qDRC(2)]
    made.RTR(1)
    made.WGO(1, 1)
    while made.IsGeneratorRunning(1)[1]:
        time.sleep(0.01)
    header = made.qDRR([1, 2], 1, 500)
    while made.bufstate is not True:
        time.sleep(0.01)
    found['sample_time'] = header['SAMPLE_TIME']
    found['off'] = float(np.abs(np.array(made.bufdata[1]) - wave).max())
    made.SVO('1', 1)
    made.MOV('1', 20.0)
    end, settled = time.monotonic() + 20.0, 0
    while settled < 10 and time.monotonic() < end:  # it passes the target before it stays there
        settled = settled + 1 if made.qONT('1')['1'] else 0
        time.sleep(0.05)
    found['position'] = made.qPOS('1')['1']
    made.SVO('1', 0)
    return found


if __name__ == '__main__':
    print(json.dumps(responses(int(sys.argv[1])), default=str), flush=True)

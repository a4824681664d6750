"""Memory layout of the kernels: parameters, derived numbers and state as structured records.

The records are NumPy structured types, so that the kernels read ``p.amplifier.delay`` and the
complete state is one value that can be copied, compared and restored. A digest of the source of
the kernels is a field name of the state, so that a cached kernel is never used with another
version of its parts.
"""

from __future__ import annotations

import hashlib
from pathlib import Path

import numpy as np

from piezo_sim.parts import (
    amplifier,
    bouc_wen,
    chain,
    drive,
    play,
    preisach,
    sensor,
    slow,
    structure,
)
from piezo_sim.plant_parameters import PlantEffect, PlantParameter

_PARTS = (amplifier, drive, bouc_wen, play, preisach, structure, slow, sensor)

PARAMETERS: tuple[PlantParameter, ...] = tuple(row for part in _PARTS for row in part.PARAMETERS)
EFFECTS: tuple[PlantEffect, ...] = tuple(row for part in _PARTS for row in part.EFFECTS)


def _digest() -> str:
    folder = Path(__file__).parent / 'parts'
    text = b''.join(file.read_bytes() for file in sorted(folder.glob('*.py')))
    return hashlib.sha256(text).hexdigest()[:16]


def _parameter_type() -> np.dtype[np.void]:
    groups: dict[str, list[tuple[str, str]]] = {}
    for row in PARAMETERS:
        group, quantity = row.name.split('.')
        groups.setdefault(group, []).append((quantity, 'f8'))
    return np.dtype([(group, np.dtype(fields)) for group, fields in groups.items()])


PARAMETER_TYPE = _parameter_type()

DERIVED_TYPE = np.dtype(
    [
        ('use_bouc_wen', '?'),
        ('use_play', '?'),
        ('use_preisach', '?'),
        ('dynamic', '?'),
        ('nonlinear', '?'),
        ('creeping', '?'),
        ('active', 'i8', (structure.MODES,)),
        ('play_count', 'i8'),
        ('play_radius', 'f8', (play.OPERATORS,)),
        ('play_weight', 'f8', (play.OPERATORS,)),
        ('play_slope', 'f8'),
        ('bouc_wen_stride', 'f8'),
        ('static_share', 'f8'),
        ('omega', 'f8', (structure.MODES,)),
        ('share', 'f8', (structure.MODES,)),
        ('propagator', 'f8', (structure.MODES, chain.LEVELS + 2, 4)),
        ('filter', 'f8', (chain.LEVELS + 1, 4)),
        ('step', 'f8', (chain.LEVELS + 2,)),
        ('stride', 'f8'),
        ('memory', '?'),
        ('zeta', 'f8'),
        ('level_still', 'i8'),
        ('level_moving', 'i8'),
        ('level_corner', 'i8'),
        ('creep_gain', 'f8', (slow.ELEMENTS,)),
        ('creep_share', 'f8', (slow.ELEMENTS,)),
    ],
    align=True,
)

_PREISACH_TYPE = np.dtype(
    [
        ('depth', 'i8'),
        ('direction', 'i8'),
        ('position', 'f8'),
        ('turn', 'f8', (preisach.DEPTH,)),
        ('level', 'f8', (preisach.DEPTH,)),
    ]
)

_SCALARS = (
    *(
        'command',
        'voltage',
        'voltage_before',
        'strain_voltage',
        'rate',
        'widening',
        'loss',
        'heat',
    ),
    *(
        'residue',
        'free',
        'slope',
        'eta',
        'lost_motion',
        'drive',
        'drive_middle',
        'drive_mean',
        'bristle',
    ),
    *(
        'yielding',
        'slow',
        'drift',
        'warmth',
        'jump',
        'filtered',
        'seen_before',
        'reading',
        'coupled',
    ),
)

STATE_TYPE = np.dtype(
    [
        ('tick', 'i8'),
        ('refused', 'i8'),
        ('fault', 'i8'),
        ('fault_ticks', 'i8'),
        ('seed', 'u8'),
        *((name, 'f8') for name in _SCALARS),
        ('x', 'f8', (structure.MODES,)),
        ('v', 'f8', (structure.MODES,)),
        ('play', 'f8', (play.OPERATORS,)),
        ('creep', 'f8', (slow.ELEMENTS,)),
        ('flicker', 'f8', (sensor.OCTAVES,)),
        ('bursting', '?'),
        ('preisach', _PREISACH_TYPE),
        (f'version_{_digest()}', '?'),
    ],
    align=True,
)

"""The actuator has other numbers than its model file says: no block, a rival of all of them."""

from piezo_hysteresis.blocks.effect import Effect

PARAMETER_SHIFT = Effect(
    name='parameter_shift',
    variant='parameter_shift',
    block=None,
    neutral={},
    physics=(
        'The law of the model holds, but its parameters are no longer those of the actuator: '
        'temperature, preload, load or age have changed since it was identified.'
    ),
    experiment='The records from which the model was identified, once more.',
    mistaken_for=('gain_decay', 'sensor_nonlinearity', 'creep'),
    held=True,
    refits=True,
)

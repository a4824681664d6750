"""Effect without a block: parameters of the actuator that differ from its model file."""

from piezo_hysteresis.blocks.effect import Effect

PARAMETER_SHIFT = Effect(
    name='parameter_shift',
    block=None,
    neutral={},
    physics=(
        'The law of the model holds, but its parameters are no longer those of the actuator: '
        'temperature, preload, load or age have changed since it was identified.'
    ),
    experiment='The records from which the model was identified, once more.',
    mistaken_for=('gain_decay', 'sensor_nonlinearity', 'creep'),
)

"""Bank of plays in parallel with the hysteresis: memory of more than the last reversal."""

from piezo_hysteresis.blocks._plays import bank_of
from piezo_hysteresis.blocks.base import Block, InterSample, Parameter, Slot
from piezo_hysteresis.blocks.effect import Coverage, Effect

_COARSE, _FINE = 9, 39


def _block(name: str, prefix: str, count: int) -> Block:
    return Block(
        name=name,
        slot=Slot.HYSTERESIS,
        parameters=(
            Parameter(
                f'{prefix}_range',
                'V',
                1.0,
                1e-9,
                1e5,
                f'Input amplitude of which the thresholds are 1/{count + 1} to '
                f'{count}/{count + 1}.',
                1.0,
                follows_range=True,
            ),
            *(
                Parameter(
                    f'{prefix}{j}',
                    'm/V',
                    0.0,
                    -1e-2,
                    1e-2,
                    f'Weight of the play of half width {j / (count + 1):g} {prefix}_range.',
                    5e-6,
                )
                for j in range(1, count + 1)
            ),
        ),
        **bank_of(1.0, 1, 0),
        state_size=count,
        between=InterSample.PATH,
        description=f'Bank of {count} play operators in parallel with the hysteresis.',
        source='Prandtl-Ishlinskii bank as a correction of Bouc-Wen',
    )


BLOCKS = (
    _block('nonlocal_memory', 'memory', _COARSE),
    _block('nonlocal_memory_fine', 'fine_memory', _FINE),
)

EFFECTS = tuple(
    Effect(
        name='nonlocal_memory',
        block=block,
        inexactness=0.07,  # few plays approximate a continuous memory
        requires=(
            'bouc_wen',
            'bouc_wen_exact',
            'bouc_wen_power',
            'bouc_wen_power_euler',
            'bouc_wen_rate',
            'bouc_wen_rate_euler',
            'bouc_wen_modified',
        ),
        holds={block.parameters[0].name: 1.0},
        neutral={each.name: 0.0 for each in block.parameters[1:]},
        starts=({each.name: 1e-5 / len(block.parameters) for each in block.parameters[1:]},),
        physics=(
            'The memory of the ceramic contains every reversal that no larger one has '
            'erased; that of Bouc-Wen is one number. Inner loops therefore close in the '
            'actuator and not in the model.'
        ),
        experiment=(
            'First-order reversal curves: triangles with decreasing amplitude and nested loops.'
        ),
        required_coverage=(Coverage.REVERSALS,),
        mistaken_for=('hysteresis_exponent', 'friction', 'stiffness'),
    )
    for block in BLOCKS
)

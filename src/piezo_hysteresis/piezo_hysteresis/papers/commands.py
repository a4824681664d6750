"""Commands that reproduce the main figures of the papers, with their expected results."""

from __future__ import annotations

from typing import NamedTuple


class Command(NamedTuple):
    """One command.

    Attributes
    ----------
    words : str
        ``piezo_sim`` is a program of its own; everything else is a verb of ``piezo``.
    figures : str
        Figures and tables that it contributes to, or ''.
    outcome : str
        Expected result in the form of test/docs/expectations.py, or ''.
    """

    words: str
    figures: str = ''
    outcome: str = ''


_BIMORPH = '--plant preset:fdk_pzba_00030'
_BIMORPH_SWEEP = 'piezo_sim sweep --preset fdk_pzba_00030 --seconds 100'
_STACK = (
    '--plant preset:xiao_pi_stack --plant-set amplifier.range_low=-30 amplifier.range_high=130 '
    '--law xiao2014 --attenuation none'
)
_STAGE = (
    'compensate --model fang_slow/model.yaml --law fang2019 --plant preset:fang_p845_stage '
    '--attenuation none --feedback fuzzy_pid --pid 1.43e5 1.43e8 120 --fuzzy 1e-7 2e-5 7.1e4 7.1e7'
)
_STAGE_SWEEP = (
    'piezo_sim sweep --preset fang_p845_stage --amplitudes 4.8 --options '
    'offset=4.9 --seconds 8 --warm-up 4'
)

COMMANDS: dict[str, tuple[Command, ...]] = {
    'Fujii 2018': (
        Command(f'{_BIMORPH_SWEEP} --frequencies 23 --out b23'),
        Command('identify b23 --method fujii2018 --model extended --warm-up 80 --out extended',
                'figures 10, 11'),
        Command('identify b23 --method fujii2018 --model enhanced3 --warm-up 80 --out enhanced',
                'figures 10, 11', 'enhanced/summary.json records[0].free_run_rms_m < 2e-6'),
        Command(f'compensate --model enhanced/model.yaml {_BIMORPH} --low -5 --high 5 --law '
                'fujii2018 --attenuation rls --orders 3 --attenuation-set forgetting=1 '
                'sign_rule=printed --reference '
                'sine:frequency=23,amplitude=143e-6,duration=40,ramp=1 --from-seconds 20 --out '
                'tracked', 'figures 16, 17',
                'tracked/summary.json runs[2].rms_without_mean_m < 5e-6'),
    ),
    'Tatebatake 2017': (
        Command(f'{_BIMORPH_SWEEP} --frequencies 10 --out b10'),
        Command('identify b10 --method rls --model classical --out basic', 'figure 11'),
        Command('identify b10 --method rls --model extended --out extended', 'figure 11',
                'extended/summary.json records[0].free_run_rms_m < 3e-6'),
        Command(f'compensate --model extended/model.yaml {_BIMORPH} --law tatebatake2017 '
                '--attenuation none --reference '
                'sine:frequency=10,amplitude=120e-6,duration=40,ramp=1 --from-seconds 20 --out '
                'tracked', 'figures 14, 20',
                'tracked/summary.json runs[1].rms_without_mean_m < 4e-6'),
    ),
    'Zhou 2021': (
        Command('piezo_sim sweep --preset zhou_tef --frequencies 1,30 --seconds 4 --out flap'),
        Command('identify flap --method zhou2021 --model second_order --hold A1=5.5e-6 '
                'stiffness=8e5 mass=0.05138 --out zhou', 'table 2, figures 6, 7',
                'zhou/summary.json records[1].free_run_rms_m < 1e-6'),
        Command('compensate --model zhou/model.yaml --plant preset:zhou_tef --law zhou2021 --pid '
                '1e5 5e7 0 --attenuation none --reference '
                'sine:frequency=10,amplitude=200e-6,duration=4,ramp=0.3 --out tracked',
                'figures 9, 11, 12', 'tracked/summary.json runs[2].largest_m < 9e-6'),
    ),
    'Xiao 2014': (
        Command('piezo_sim sweep --preset xiao_pi_stack --waveform triangle --frequencies '
                '10,40,100 --seconds 1 --out stack'),
        Command('identify stack --method xiao2014 --model inverse_selector --out xiao'),
        Command(f'compensate --model xiao/model.yaml {_STACK} --reference '
                'triangle:frequency=40,amplitude=15e-6,duration=2 --from-seconds 1.2 --out '
                'tracked', 'table 1, figure 15', 'tracked/summary.json runs[1].rms_m < 1.895e-6'),
        Command('piezo_sim sweep --preset xiao_pi_stack --waveform step --amplitudes 2 --options '
                'offset=0,delay=0.005 --seconds 0.6 --warm-up 0 --out step'),
        Command('linear step --method arx --out linear.yaml', 'figure 12',
                'linear.yaml nrmse_percent < 5.0'),
        Command(f'compensate --model xiao/model.yaml {_STACK} --feedback h_infinity --bandwidth '
                '150 --h-infinity-set peak=2 control=0.3 --transfer-function linear.yaml '
                '--reference composite_xiao2014:amplitude=12e-6,duration=1.5,ramp=0.3 '
                '--from-seconds 0.75 --out closed', 'figure 19',
                'closed/summary.json runs[2].largest_m < 1e-6'),
    ),
    'Fang 2019': (
        Command(f'{_STAGE_SWEEP} --frequencies 0.5,1,5,10 --out stage'),
        Command(f'{_STAGE_SWEEP} --frequencies 0.5,1 --out slow'),
        Command('identify stage --method fang2019 --model rate_dependent --max-evaluations 6000 '
                '--out fang', 'figure 4, table 1',
                'fang/summary.json records[0].nrmse_percent < 5.0'),
        Command('identify slow --method fang2019 --model classical --out fang_slow'),
        Command(f'{_STAGE} --reference sine:frequency=1,amplitude=6e-6,duration=12,ramp=1 '
                '--from-seconds 6 --out tracked', 'figure 8',
                'tracked/summary.json runs[2].largest_m < 0.045e-6'),
    ),
}  # fmt: skip
"""Commands of each paper, to be run one after another in one folder."""

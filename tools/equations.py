"""Subject, command and figures of each numbered equation of the five papers."""

from __future__ import annotations

from typing import NamedTuple


class Equation(NamedTuple):
    """One equation."""

    about: str  # what it is
    command: str = ''  # what a user types to use it; '' where the code has it in a larger step
    figures: str = ''  # figures and tables of the paper that it stands behind, or ''


_RLS = 'identify --method fujii2018'
_LAW = 'compensate --set feedforward.law'
_CONTROL = f'{_LAW}=fujii2018'
_ATTENUATED = f'{_CONTROL} attenuation.method=rls'
_BASIC = 'identify --method rls --model classical'

EQUATIONS: dict[str, dict[str, Equation]] = {
    'Fujii 2018': {
        '1': Equation('Bouc-Wen model, continuous', 'identify --model classical'),
        '2': Equation('Bouc-Wen model, discrete', 'identify --model classical_euler'),
        '3': Equation('extended model: off-centre, autoregression', f'{_RLS} --model extended',
                      'figures 4, 10'),
        '4': Equation('sine and cosine of the third harmonic', f'{_RLS} --model enhanced3'),
        '5': Equation('sine and cosine of the fifth harmonic', f'{_RLS} --model enhanced5'),
        '6': Equation('enhanced model, third harmonic', f'{_RLS} --model enhanced3',
                      'figures 8, 10, 11'),
        '7': Equation('enhanced model, fifth harmonic', f'{_RLS} --model enhanced5', 'figure 10'),
        '8': Equation('linear regression', _RLS, 'figure 10'),
        '9': Equation('parameters, third harmonic', _RLS, 'figure 10'),
        '10': Equation('regressor, third harmonic, as printed',
                       'identify --method rls --model extended_free'),
        '11': Equation('parameters, fifth harmonic', _RLS, 'figure 10'),
        '12': Equation('regressor, fifth harmonic', _RLS, 'figure 10'),
        '13': Equation('sine for the identification',
                       'piezo_sim sweep --waveform sine --frequencies 1:50', 'figures 2 to 7'),
        '14': Equation('direct inverse of the classical model', f'{_LAW}=zhou2021'),
        '15': Equation('direct inverse of the extended model, not causal', _CONTROL),
        '16': Equation('direct inverse, rising voltage', _CONTROL, 'figures 13, 16, 17'),
        '17': Equation('direct inverse, falling voltage', _CONTROL, 'figures 13, 16, 17'),
        '18': Equation('third harmonic of the error', f'{_ATTENUATED} attenuation.orders=[3]',
                       'figures 16, 17'),
        '19': Equation('fifth harmonic of the error', f'{_ATTENUATED} attenuation.orders=[5]',
                       'figure 16'),
        '20': Equation('voltage less the third harmonic', f'{_ATTENUATED} attenuation.orders=[3]',
                       'figures 16, 17'),
        '21': Equation('voltage less the fifth harmonic', f'{_ATTENUATED} attenuation.orders=[5]',
                       'figure 16'),
        '22': Equation('sign of the error up to 66 Hz',
                       f'{_ATTENUATED} attenuation.sign_rule=printed', 'figures 16, 17'),
        '23': Equation('sign of the error above 66 Hz',
                       f'{_ATTENUATED} attenuation.sign_rule=printed', 'figures 16, 17'),
        '24': Equation('desired displacement',
                       'compensate --reference sine:frequency=23,amplitude=...',
                       'figures 16, 17'),
        '25': Equation('amplitude of the desired displacement',
                       'python studies/papers/fujii2018.py --figure 16',
                       'figures 16, 17'),
    },
    'Tatebatake 2017': {
        '1': Equation('Bouc-Wen model with exponent n', 'identify --model classical_power'),
        '2': Equation('Bouc-Wen model, n = 1', 'identify --model classical', 'figure 1'),
        '3': Equation('modified model, off-centre', 'identify --model modified', 'figure 3'),
        '4': Equation('slope by direction in the modified model', 'identify --model modified'),
        '5': Equation('modified model with its output', 'identify --model modified'),
        '6': Equation('modified model, discrete', 'identify --model modified_euler', 'figure 5'),
        '7': Equation('extended model', 'identify --model extended', 'figures 8, 11'),
        '8': Equation('linear regression', 'identify --method tatebatake2017', 'figure 11'),
        '9': Equation('parameters', 'identify --method tatebatake2017', 'figure 11'),
        '10': Equation('regressor as printed', 'identify --method tatebatake2017', 'figure 11'),
        '11': Equation('error of the regression', 'identify --method tatebatake2017'),
        '12': Equation('feedforward as printed', f'{_LAW}=tatebatake2017',
                       'figures 14 to 16, 20 to 22'),
        '13': Equation('desired displacement',
                       'compensate --reference sine:frequency=10,amplitude=...', 'figure 14'),
        '14': Equation('amplitude of the desired displacement',
                       'python studies/papers/tatebatake2017.py --figure 14', 'figure 14'),
        '15': Equation('sine for the identification',
                       'piezo_sim sweep --waveform sine --frequencies 1:30', 'figures 6, 7'),
        '16': Equation('tracking error', 'compensate', 'figure 14'),
        '17': Equation('basic model, continuous', _BASIC, 'figures 11, 12'),
        '18': Equation('basic model, discrete', _BASIC, 'figures 11, 12'),
    },
    'Zhou 2021': {
        '1': Equation('Bouc-Wen model with exponent n', 'identify --model second_order_power'),
        '2': Equation('Bouc-Wen model, n = 1', 'identify --model second_order', 'figures 6, 7'),
        '3': Equation('mass, damping and stiffness', 'identify --model second_order', 'figure 7'),
        '4': Equation('natural frequency', 'identify --model second_order --hold mass=...'),
        '5': Equation('mass from the natural frequency',
                      'identify --model second_order --hold mass=...'),
        '6': Equation('quasi-static displacement', 'identify --method zhou2021', 'figure 6'),
        '7': Equation('objective of the swarm', 'identify --method zhou2021', 'table 2'),
        '8': Equation('feedforward', f'{_LAW}=zhou2021', 'figures 9, 11 to 13'),
        '9': Equation('sum of sinusoids', 'compensate --reference composite_zhou2021_low:...',
                      'figure 13'),
    },
    'Xiao 2014': {
        '1': Equation('Bouc-Wen model', 'identify --method xiao2014 --model classical',
                      'figures 7, 8'),
        '2': Equation('objective of the swarm', 'identify --method xiao2014', 'figures 7, 8'),
        '3': Equation('inverse before the plant', f'{_LAW}=xiao2014',
                      'table 1, figures 14 to 18'),
        '4': Equation('transfer function by ARX', 'linear --method arx', 'figure 12'),
        '5': Equation('its state space, for H-infinity',
                      'compensate --transfer-function', 'figures 19, 20'),
    },
    # Its equations are pictures that are missing from the text, which has one number, (9).
    'Fang 2019': {
        'stiffness': Equation('stiffness of the guide', 'piezo_sim stage'),
        'swarm': Equation('swarm with constriction and falling inertia',
                          'identify --method fang2019', 'figure 4, table 1'),
        'classical model': Equation('Bouc-Wen model up to 1 Hz',
                                    'identify --method fang2019 --model classical'),
        '9': Equation('modified model, reconstructed',
                      'identify --method fang2019 --model rate_dependent', 'figure 4, table 1'),
        'feedforward': Equation('inverse by the estimated hysteresis',
                                f'{_LAW}=fang2019', 'figures 7 to 11'),
        'PID': Equation('feedback', 'compensate --set feedback.method=pid', 'figures 7 to 11'),
        'switch': Equation('one model below and one above 1 Hz',
                           'python studies/papers/fang2019.py --figure 7', 'figures 7 to 11'),
        'fuzzy PID': Equation('gains by fuzzy rules', 'compensate --set feedback.method=fuzzy_pid',
                              'figures 7 to 11'),
    },
}  # fmt: skip

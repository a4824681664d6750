"""What a user chooses about a feedback law: gains, fuzzy scales, H-infinity weights."""

from __future__ import annotations

from dataclasses import dataclass

from piezo_hysteresis.common.parameter_table import documented, judge, setting
from piezo_hysteresis.errors import CompensationError

#: Laws on the tracking error.
FEEDBACKS = ('none', 'pid', 'fuzzy_pid', 'h_infinity')


@documented
@dataclass(frozen=True)
class PidGains:
    """Gains of a PID controller on the displacement error d - y.

    Raises
    ------
    CompensationError
        If one is invalid.
    """

    proportional: float = setting(0.0, 'Proportional gain.', 'V/m', low=0.0, high=1e12)
    integral: float = setting(3e4, 'Integral gain.', 'V/(m s)', low=0.0, high=1e12)
    derivative: float = setting(0.0, 'Derivative gain.', 'V s/m', low=0.0, high=1e12)
    derivative_filter: float = setting(
        2e-3, 'Time constant of the low-pass filter on the derivative.', 's', above=0.0, high=60.0
    )
    tracking_time: float = setting(
        0.05,
        'Anti-windup: tracking time constant of the integral in saturation.',
        's',
        above=0.0,
        high=1e6,
    )

    def __post_init__(self) -> None:
        for name in ('proportional', 'integral', 'derivative'):
            value = getattr(self, name)
            if not value >= 0.0:
                raise CompensationError(
                    f'the {name} gain must be 0 or more, got {value:g}; a plant of the opposite '
                    'sign is corrected at the sensor or amplifier, not by a negative gain'
                )
        refuse(judge(self))


@documented
@dataclass(frozen=True)
class FuzzyScales:
    """Input and output scales of a fuzzy PID.

    Raises
    ------
    CompensationError
        If one is impossible.
    """

    error_scale: float = setting(5e-6, 'Error that counts as big.', 'm', above=0.0, high=0.01)
    rate_scale: float = setting(
        1e-3, 'Rate of the error that counts as big.', 'm/s', above=0.0, high=100.0
    )
    proportional_range: float = setting(
        0.0, 'Largest change of the proportional gain.', 'V/m', low=0.0, high=1e12
    )
    integral_range: float = setting(
        1e4, 'Largest change of the integral gain.', 'V/(m s)', low=0.0, high=1e12
    )

    def __post_init__(self) -> None:
        refuse(judge(self))


@documented
@dataclass(frozen=True)
class HInfinityWeights:
    """What the closed loop shall achieve; Xiao 2014 gives no weights.

    The loop stays stable while the plant differs from its model, at any frequency, by less than
    ``control / gamma`` times its gain at rest.

    Raises
    ------
    CompensationError
        If one is impossible.
    """

    bandwidth: float = setting(
        2.0, 'Bandwidth: frequency up to which errors are attenuated.', 'Hz', above=0.0, high=1e4
    )
    steady_error: float = setting(
        1e-3, 'Remaining fraction of a constant disturbance.', '1', above=0.0, high=1.0
    )
    peak: float = setting(
        1.6,
        'Largest amplification of errors beyond the bandwidth; small values give robustness.',
        '1',
        above=1.0,
        high=100.0,
    )
    control: float = setting(0.5, 'Weight of the voltage.', '1', above=0.0, high=1e6)
    delay_ticks: int = setting(
        1,
        'Delay of the measurement in samples; 1 in lock-step. The hold of the voltage is '
        'included separately.',
        '1',
        low=0,
        high=20,
    )

    def __post_init__(self) -> None:
        if self.delay_ticks != int(self.delay_ticks):
            raise CompensationError('delay_ticks must be a whole number from 0')
        object.__setattr__(self, 'delay_ticks', int(self.delay_ticks))
        refuse(judge(self))


def refuse(reason: str) -> None:
    """Raise an error if there is a reason.

    Raises
    ------
    CompensationError
        With the reason.
    """
    if reason:
        raise CompensationError(reason)

"""What a model with values offers in Python: its parameters, inverse, response and export."""

from __future__ import annotations

import importlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.common.plain_yaml import write_atomically
from piezo_hysteresis.common.results import Plottable
from piezo_hysteresis.common.wording import Guided, choices, counted
from piezo_hysteresis.errors import ModelError

# Imported at the first call: a model knows no inverse and no compiler.
_FUNCTIONS = 'piezo_hysteresis.interface.model_functions'
#: Other usual names of parameters.
_ALIASES = {
    'mode_frequency': 'natural_frequency',
    'resonance_frequency': 'natural_frequency',
    'f0': 'natural_frequency',
    'damping': 'damping_ratio',
    'zeta': 'damping_ratio',
}


@dataclass(frozen=True, repr=False, eq=False)
class InverseResult(Plottable):
    """Voltage for a reference; ``numpy.asarray`` of it is the voltage.

    Attributes
    ----------
    dt : float
        Sampling interval [s].
    reference, voltage, displacement : ndarray, shape (n,)
        Desired displacement [m], voltage within the limits [V], displacement of the model [m].
    limited : tuple of str
        What was limited, in sentences; empty if nothing was.
    warnings : tuple of str
        What limits the use of the voltage, in sentences.
    """

    _INSTEAD: ClassVar = {
        'voltage': 'u to_numpy',
        'displacement': 'y',
        'displacement - reference': 'error rms',
    }

    dt: float
    reference: FloatArray
    voltage: FloatArray
    displacement: FloatArray
    limited: tuple[str, ...]
    warnings: tuple[str, ...]

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> NDArray[Any]:
        return np.array(self.voltage, dtype=dtype)

    def __len__(self) -> int:
        return int(self.voltage.size)

    def __repr__(self) -> str:
        error = 1e6 * float(np.sqrt(np.mean((self.displacement - self.reference) ** 2)))
        first = (
            f'Feedforward: {counted(len(self), "sample")} at {1 / self.dt:g} Hz, '
            f'{self.voltage.min():.4g} to {self.voltage.max():.4g} V, the model misses the '
            f'reference by {error:.3g} µm rms'
        )
        return '\n  '.join([first, *self.limited, *self.warnings])

    def columns(self) -> dict[str, FloatArray]:
        """Return the samples by column, each of shape (n,)."""
        return {
            'time_s': np.asarray(self.dt * np.arange(len(self)), np.float64),
            'voltage_V': self.voltage,
            'displacement_m': self.displacement,
            'reference_m': self.reference,
        }

    def save(self, path: str | Path) -> None:
        """Write the columns as CSV."""
        columns = self.columns()
        with write_atomically(Path(path)) as temporary:
            np.savetxt(
                temporary, np.column_stack(list(columns.values())), '%.9g', ',',
                header=','.join(columns), comments='',
            )  # fmt: skip


class ModelActions(Guided):
    """Base of `ModelFile` and of results that contain a model."""

    _INSTEAD: ClassVar = {
        'frequency_response(frequency)': 'freqresp bode',
        'parameters': 'get_params coef_ theta',
        'inverse(reference, dt)': 'invert',
    }

    @property
    def parameters(self) -> dict[str, float]:
        """Every parameter by name, in SI units; `to_frame` has standard deviations and units."""
        values = getattr(self, 'values', None)
        return dict(cast(Any, self).model.values if values is None else values)

    def __getitem__(self, name: str) -> float:
        values = self.parameters
        if name in values:
            return values[name]
        if _ALIASES.get(name, '') in values:
            return values[_ALIASES[name]]
        raise ModelError(f'the model has no parameter {name}{choices(name, values)}')

    def frequency_response(
        self, frequency: ArrayLike, *, amplitude: float | None = None, rate: float | None = None
    ) -> NDArray[np.complex128]:
        """Return the complex gain for a small tone on top of a large drive.

        Parameters
        ----------
        frequency : array_like
            Frequencies [Hz], below half the rate.
        amplitude : float, optional
            Amplitude of the large drive [V]; half the range over which the model was identified.
        rate : float, optional
            Sampling rate [Hz]; that of the data of the model, or 1000. The zero-order hold of the
            voltage is included.

        Returns
        -------
        ndarray, shape of `frequency`
            Gain [m/V]; the hysteresis contributes its mean slope.

        Raises
        ------
        PiezoError
            If a frequency is not below half the rate, or the range of the model is unknown and no
            amplitude is given.
        """
        found: NDArray[np.complex128] = importlib.import_module(_FUNCTIONS).frequency_response(
            self, frequency, amplitude=amplitude, rate=rate
        )
        return found

    def inverse(
        self,
        reference: ArrayLike,
        dt: float | None = None,
        *,
        low: float | None = None,
        high: float | None = None,
        slew: float | None = None,
        law: str = 'auto',
    ) -> InverseResult:
        """Return the voltage with which the model follows a reference.

        Parameters
        ----------
        reference : array_like, shape (n,)
            Desired displacement [m].
        dt : float, optional
            Sampling interval [s]; that of the data of the model, or 1 ms.
        low, high, slew : float, optional
            Limits of the voltage [V], [V/s]; those of the data of the model.
        law : str
            Kind of inverse, one of `piezo_hysteresis.compensation.link.INVERSES`.

        Returns
        -------
        InverseResult
            `voltage`, the `displacement` that the model then has, and what was `limited`.

        Raises
        ------
        PiezoError
            If the reference is no series of numbers, or the model has no inverse.
        """
        found: InverseResult = importlib.import_module(_FUNCTIONS).inverse(
            self, reference, dt, low=low, high=high, slew=slew, law=law
        )
        return found

    def export(self, path: str | Path, **options: Any) -> Path:
        """Write model and loop as a C library, see `piezo_hysteresis.export`."""
        found: Path = importlib.import_module(_FUNCTIONS).export(self, path, **options)
        return found

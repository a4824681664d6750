"""An identified model instead of the actuator, for studies without hardware."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from piezo_hysteresis.models.chain import Model


class ModelPlant:
    """Answers voltages with the displacement of a model, one tick at a time.

    Parameters
    ----------
    model : Model
        Chain of blocks.
    values : mapping of str to float
        Its parameters, SI units.
    dt : float
        Sampling interval [s].
    noise : float
        Rms of white measurement noise [m].
    seed : int
        Seed of the noise.
    """

    def __init__(
        self,
        model: Model,
        values: Mapping[str, float],
        dt: float,
        *,
        noise: float = 0.0,
        seed: int = 0,
    ) -> None:
        self._model = model
        self._packed = model.pack(values)
        self._dt = dt
        self._noise = noise
        self._seed = seed
        self._voltage = np.zeros(1)
        self.reset()

    def reset(self) -> None:
        """Return to rest and restart the noise."""
        self._state = self._model.initial_state(self._dt)
        self._random = np.random.default_rng(self._seed)

    def exchange(self, voltage: float) -> float:
        """Apply `voltage` [V] for one tick; return the displacement of the tick [m]."""
        self._voltage[0] = voltage
        response = self._model.respond(self._voltage, self._packed, self._dt, state=self._state)
        displacement = float(response[0])
        if self._noise > 0.0:
            displacement += self._noise * float(self._random.standard_normal())
        return displacement

"""A simulated straight line with effects switched on, and what it answers when settled."""

from __future__ import annotations

from typing import Any

from sim_signals import sine

from piezo_sim import Plant


def plant(effect: Any, *others: Any, rate: float = 1000.0, seed: Any = 0, **values: Any) -> Plant:
    """Return a straight line with some effects on; keywords have __ for the dot."""
    on = {f'effects.{name}': True for name in (effect, *others)}
    numbers = {key.replace('__', '.'): value for key, value in values.items()}
    return Plant({**on, **numbers}, rate=rate, seed=seed)


def held(p: Any, f: Any, amplitude: float = 1.0, seconds: float = 2.0, tail: float = 1.0) -> Any:
    """Return the reading, and the voltages that it answers, over the last periods."""
    p.reset()
    _, command = sine(f, amplitude, seconds, p.rate)
    count = round(tail * p.rate)
    return p.run(command)[-count:], command[-count - 1 : -1]

"""Controllers of piezosystem jena with the commands of the NV200: NV200, NV200/D NET."""

from piezo_hysteresis.drivers.nv200.nv200_controller import Nv200Connection, Nv200Controller

__all__ = ['Nv200Connection', 'Nv200Controller']

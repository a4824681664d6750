"""Parameters from records: RLS family, output error, swarms; and identifiability."""

from piezo_hysteresis.identification.fit import FitResult, fit
from piezo_hysteresis.identification.fit_data import FitData, targets_of
from piezo_hysteresis.identification.identify import Identification, identify
from piezo_hysteresis.identification.methods import METHODS
from piezo_hysteresis.identification.objective import Prior
from piezo_hysteresis.identification.online import online
from piezo_hysteresis.identification.output_error import output_error
from piezo_hysteresis.identification.recursion import Estimate, OnlineMethod
from piezo_hysteresis.identification.rls import OnlineRls, RlsSettings
from piezo_hysteresis.identification.rls_ud import OnlineBank, OnlineUd, UdSettings
from piezo_hysteresis.identification.simulate import simulate
from piezo_hysteresis.identification.validate import Validation, validate

__all__ = [
    'METHODS',
    'Estimate',
    'FitData',
    'FitResult',
    'Identification',
    'OnlineBank',
    'OnlineMethod',
    'OnlineRls',
    'OnlineUd',
    'Prior',
    'RlsSettings',
    'UdSettings',
    'Validation',
    'fit',
    'identify',
    'online',
    'output_error',
    'simulate',
    'targets_of',
    'validate',
]

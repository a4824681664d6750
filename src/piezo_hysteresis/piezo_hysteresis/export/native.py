"""Kernels as machine code without Python, from the LLVM code of numba.

Numba compiles a kernel to LLVM code like a C compiler, with a wrapper for Python. The wrapper is
omitted: a C function calls the kernel, all other functions become private, and unused ones are
removed. The code is optimised for the baseline of the target only, without contraction of products
and sums, so that the results are bitwise those of the kernels in Python.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from piezo_hysteresis.errors import PiezoError

#: Known targets: LLVM names of machine and processor, and common names.
TARGETS: dict[str, tuple[str, str]] = {
    'x86_64-linux': ('x86_64-unknown-linux-gnu', 'x86-64'),
    'aarch64-linux': ('aarch64-unknown-linux-gnu', 'generic'),
}
# Functions of the C library that every target has, in libm or elsewhere; a call of another
# function is a defect of a kernel.
_ALLOWED = frozenset(
    [
        'acos',
        'acosh',
        'asin',
        'asinh',
        'atan',
        'atan2',
        'atanh',
        'cbrt',
        'ceil',
        'copysign',
        'cos',
        'cosh',
        'exp',
        'exp2',
        'expm1',
        'fabs',
        'floor',
        'fmax',
        'fmin',
        'fmod',
        'frexp',
        'hypot',
        'ldexp',
        'log',
        'log10',
        'log1p',
        'log2',
        'memcpy',
        'memmove',
        'memset',
        'pow',
        'rint',
        'round',
        'sin',
        'sincos',
        'sinh',
        'sqrt',
        'tan',
        'tanh',
        'trunc',
    ]
)


# Python exceptions with their source positions, which are not used here.
_ERRORS = re.compile(r'(@\.const\.pickledata\.\S+ = .*? constant \[\d+ x i8\] )c".*"')


class ExportError(PiezoError):
    """A model, law or target for which no library can be exported."""


@dataclass(frozen=True)
class Entry:
    """One function of the library."""

    name: str  # its C name
    kernel: Callable[..., Any]  # dispatcher of numba; returns an int
    arguments: str  # one letter for each argument


def object_code(entries: Sequence[Entry], target: str) -> bytes:
    """Return an object file in which only the functions of `entries` are visible."""
    import llvmlite.binding as llvm

    triple, processor = known_target(target)
    llvm.initialize_all_targets()
    llvm.initialize_all_asmprinters()
    machine = llvm.Target.from_triple(triple).create_target_machine(
        cpu=processor, opt=3, reloc='pic', codemodel='default'
    )
    whole = llvm.parse_assembly('')
    for entry in entries:
        name, text = _compiled(entry)
        whole.link_in(llvm.parse_assembly(text))
        whole.link_in(llvm.parse_assembly(_door(entry, name)))
    whole.triple, whole.data_layout = triple, str(machine.target_data)
    _hide(whole, {entry.name for entry in entries})
    _optimise(whole, machine)
    foreign = sorted(_foreign(whole) - _ALLOWED)
    if foreign:
        raise ExportError(f'a kernel of this model needs {", ".join(foreign)}; report this model')
    return bytes(machine.emit_object(whole))


def known_target(target: str) -> tuple[str, str]:
    """Return the LLVM names of a target."""
    if target not in TARGETS:
        raise ExportError(
            f'there is no target {target}; choose one of {", ".join(TARGETS)}, or ask for '
            'yours in an issue'
        )
    return TARGETS[target]


def _compiled(entry: Entry) -> tuple[str, str]:
    """Return the name of the function of a kernel, and the LLVM code of all functions it calls."""
    from numba import types

    kinds = {'p': types.CPointer(types.float64), 'd': types.float64}
    signature = tuple(kinds[letter] for letter in entry.arguments)
    dispatcher: Any = entry.kernel
    dispatcher.compile(signature)
    found = dispatcher.overloads[signature]
    return found.fndesc.llvm_func_name, _ERRORS.sub(
        r'\1zeroinitializer', found.library.get_llvm_str()
    )


def _door(entry: Entry, name: str) -> str:
    """Return the C function that calls a kernel: its return value, or -1 if the kernel failed."""
    kinds = [{'p': 'ptr', 'd': 'double'}[letter] for letter in entry.arguments]
    plain = ', '.join(f'{kind} %a{k}' for k, kind in enumerate(kinds))
    handed = f'ptr %answer, ptr %reason, {plain}'
    types = ', '.join(['ptr', 'ptr', *kinds])
    return f"""
declare i32 @{name}({types})
define i32 @{entry.name}({plain}) {{
  %answer = alloca i64
  %reason = alloca ptr
  store i64 0, ptr %answer
  %status = call i32 @{name}({handed})
  %failed = icmp ne i32 %status, 0
  %wide = load i64, ptr %answer
  %narrow = trunc i64 %wide to i32
  %code = select i1 %failed, i32 -1, i32 %narrow
  ret i32 %code
}}
"""


def _hide(whole: Any, seen: set[str]) -> None:
    """Make all functions private except those with these names."""
    for each in (*whole.functions, *whole.global_variables):
        if not each.is_declaration and each.name not in seen and not each.name.startswith('llvm.'):
            each.linkage = 'internal'


def _optimise(whole: Any, machine: Any) -> None:
    import llvmlite.binding as llvm

    tuning = llvm.create_pipeline_tuning_options(speed_level=2)
    # rows are short: vectorisation only makes the code larger
    tuning.loop_vectorization = tuning.slp_vectorization = tuning.loop_unrolling = False
    builder = llvm.create_pass_builder(machine, tuning)
    passes = builder.getModulePassManager()
    passes.add_global_dead_code_eliminate_pass()
    passes.run(whole, builder)


def _foreign(whole: Any) -> set[str]:
    return {
        each.name
        for each in whole.functions
        if each.is_declaration and not each.name.startswith('llvm.')
    }

"""Mitsuba and Dr.Jit in this machine's variant.

Mitsuba has one variant at a time in a process; choose it before the first use.
"""

from importlib import import_module
from typing import Any

from advercity_mitsuba.devices import find_device

# Before the imports: Dr.Jit reads where LLVM is when it is loaded.
_VARIANT = find_device().variant
mi: Any = import_module("mitsuba")
"""Mitsuba's types and functions."""
dr: Any = import_module("drjit")
"""Dr.Jit, which compiles computations with Mitsuba's arrays."""


def activate_variant() -> None:
    """Make `mi` the variant of this machine."""
    if mi.variant() != _VARIANT:
        mi.set_variant(_VARIANT)


activate_variant()

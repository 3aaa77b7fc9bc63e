"""Random numbers of the cells of a lattice, and value noise, as the shaders of other backends have.

Patterns on surfaces are in the same places whichever backend shows them.
"""

from typing import Any

from advercity_mitsuba.variant import dr, mi


def hash_cell(x: Any, y: Any, salt: Any) -> Any:
    """Compute a pseudorandom number in [-1, 1) of a cell by its integers."""
    return mi.Float(hash_bits(x, y, salt) >> 8) / 8388608.0 - 1.0


def hash_bits(x: Any, y: Any, salt: Any) -> Any:
    """Compute 32 pseudorandom bits of a cell by its integers."""
    return _mix(
        mi.UInt32(x) * 0x9E3779B1
        ^ mi.UInt32(y) * 0x85EBCA6B
        ^ mi.UInt32(mi.Int32(salt)) * 0xC2B2AE35
    )


def _mix(h: Any) -> Any:
    h = (h ^ (h >> 16)) * 0x7FEB352D
    h = (h ^ (h >> 15)) * 0x846CA68B
    return h ^ (h >> 16)


def value_noise(point: Any, salt: Any) -> Any:
    """Evaluate noise of mean 0 with a lattice of 1 at points of the plane."""
    cell = dr.floor(point)
    f = point - cell
    f = f * f * (3.0 - 2.0 * f)
    i = mi.Vector2i(cell)
    low = dr.lerp(hash_cell(i.x, i.y, salt), hash_cell(i.x + 1, i.y, salt), f.x)
    high = dr.lerp(hash_cell(i.x, i.y + 1, salt), hash_cell(i.x + 1, i.y + 1, salt), f.x)
    return dr.lerp(low, high, f.y)


def retained_contrast(wavelength: Any, footprint: Any) -> Any:
    """Compute the contrast of a pattern of a wavelength left in a pixel, both in metres."""
    return dr.clip(1.5 - 3.0 * footprint / wavelength, 0.0, 1.0)


def smoothstep(low: float, high: float, value: Any) -> Any:
    """Interpolate smoothly from 0 at `low` to 1 at `high`."""
    t = dr.clip((value - low) / (high - low), 0.0, 1.0)
    return t * t * (3.0 - 2.0 * t)

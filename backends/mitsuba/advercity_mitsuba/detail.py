"""Detail of materials: the ratio of their albedo to its mean, a factor around 1.

It depends on world position alone, so it never repeats in sight. Every octave has the mean 0 and
fades where its wavelength comes close to the footprint of a pixel, against shimmer. Images of
materials have the detail finer than `MAPPED_M`.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from advercity.geometry.arrays import Float32Array
from advercity.materials import Texture
from advercity_mitsuba.noise import hash_bits, hash_cell, retained_contrast, value_noise
from advercity_mitsuba.variant import dr, mi
from advercity_mitsuba.weathering import LOGISTIC, WeatherTables, compute_wear

MAPPED_M = 0.3
LEVEL_SLOPE = 0.3
"""Sine of the slope up to which a surface counts as level."""
LEAF_M, BRANCH_M = 0.11, 0.3
LEAF_JITTER = 0.8
"""How far leaves are off the corners of their lattice, over its cells."""
MAX_OCTAVES = 9
OCTAVE_COLUMNS = 8
"""Numbers of an octave: contrast of tone and of hue, wavelength, salt; stretch of the three axes,
and whether it lies along the surface (1) or the world (0)."""


@dataclass(frozen=True)
class _Octave:
    """Noise of one wavelength.

    Attributes:
        wavelength_m: Wavelength of the lattice.
        salt: Key of the noise.
        tone: Contrast.
        hue: Contrast between green (negative) and yellow.
        stretch: Factors of the axes; a height of 0 is noise of the plane.
        is_along_surface: Whether the axes are the surface's rather than the world's.
    """

    wavelength_m: float
    salt: int
    tone: float = 0.0
    hue: float = 0.0
    stretch: tuple[float, float, float] = (1.0, 1.0, 0.0)
    is_along_surface: bool = False


def _of_space(wavelength_m: float, salt: int, tone: float = 0.0, hue: float = 0.0) -> _Octave:
    return _Octave(wavelength_m, salt, tone, hue, (1.0, 1.0, 1.0))


def _of_surface(
    wavelength_m: float, salt: int, tone: float = 0.0, hue: float = 0.0, squeeze: float = 1.0
) -> _Octave:
    return _Octave(wavelength_m, salt, tone, hue, (1.0, squeeze, 0.0), is_along_surface=True)


_FOLIAGE = (
    _of_space(0.6, 2, 0.35),
    _of_space(0.35, 3, hue=0.12),
    _Octave(6.0, 4, hue=0.20),
)
_CROWN = (
    _of_space(1.1, 5, 0.25),
    _of_space(0.35, 3, hue=0.12),
    _Octave(6.0, 4, hue=0.20),
)
OCTAVES: dict[Texture, tuple[_Octave, ...]] = {
    Texture.ASPHALT: (
        _Octave(0.025, 1, 0.30),
        _Octave(0.11, 2, 0.10),
        _Octave(0.9, 3, 0.10),
        _Octave(4.3, 4, 0.07),
        _Octave(23.0, 5, 0.06),
    ),
    Texture.GRASS: (
        _Octave(0.035, 1, 0.35),
        _Octave(0.16, 2, 0.28),
        _Octave(1.1, 3, 0.32),
        _Octave(2.3, 4, 0.24),
        _Octave(7.7, 7, 0.13),
        _Octave(1.3, 8, hue=0.14),
        _Octave(3.1, 5, hue=0.14),
        _Octave(11.0, 9, hue=0.10),
        _Octave(31.0, 6, hue=0.10),
    ),
    Texture.SOIL: (
        _Octave(0.06, 1, 0.35),
        _Octave(0.33, 2, 0.25),
        _Octave(2.7, 3, 0.15),
        _Octave(19.0, 4, 0.12),
    ),
    Texture.CROPS: (
        _of_space(0.09, 1, 0.35),
        _Octave(0.45, 2, 0.25),
        _Octave(1.6, 6, 0.20),
        _Octave(4.1, 3, 0.18),
        _Octave(2.3, 7, hue=0.12),
        _Octave(9.0, 4, hue=0.14),
        _Octave(37.0, 5, hue=0.14),
    ),
    Texture.LEAVES: _FOLIAGE,
    Texture.CROWN: _CROWN,
    Texture.BARK: (_Octave(0.05, 1, 0.55, stretch=(1.0, 1.0, 0.15)), _of_space(0.4, 2, 0.25)),
    Texture.BRICK: (_of_surface(1.1, 2, 0.12), _of_surface(5.0, 3, 0.12)),
    Texture.PLASTER: (
        _of_surface(0.05, 1, 0.08),
        _of_surface(1.3, 2, 0.07),
        _of_surface(0.35, 3, 0.10, squeeze=0.17),
        _of_surface(5.1, 4, 0.08),
        _of_surface(2.9, 5, hue=0.03),
    ),
    Texture.TILES: (_of_surface(2.3, 2, 0.12), _of_surface(6.0, 3, hue=-0.10)),
    Texture.WOOD: (_of_surface(0.02, 2, 0.25, squeeze=0.08),),
    Texture.PAVING: (
        _of_surface(0.03, 1, 0.12),
        _of_surface(0.7, 2, 0.10),
        _of_surface(6.1, 3, 0.08),
    ),
    Texture.SLABS: (_of_surface(2.3, 1, 0.10), _of_surface(9.1, 2, 0.08)),
    Texture.STONE: (_of_space(0.04, 1, 0.25), _of_space(0.5, 2, 0.12)),
    Texture.MARKING: (_Octave(0.04, 1, 0.10), _Octave(0.35, 2, 0.10), _Octave(3.0, 3, 0.08)),
}


def build_octave_table() -> Any:
    """Copy the octaves of all textures to the device; unused ones have no contrast."""
    table: Float32Array = np.zeros((len(Texture), MAX_OCTAVES, OCTAVE_COLUMNS), np.float32)
    table[..., 2] = 1.0
    for texture, octaves in OCTAVES.items():
        for row, one in enumerate(octaves):
            values = [one.tone, one.hue, one.wavelength_m, one.salt, *one.stretch]
            table[texture, row] = [*values, one.is_along_surface]
    octaves = mi.Float(table.ravel())
    dr.make_opaque(octaves)
    return octaves


def compute_detail(
    octaves: Any, w: WeatherTables, kind: Any, mapped: Any, p: Any, n: Any, footprint: Any
) -> Any:
    """Compute the factor of a material's albedo.

    Args:
        octaves: The table of `build_octave_table`.
        w: Tables with the map of wear.
        kind: Number of the material's `Texture`.
        mapped: Whether it has images.
        p: Points of the world, metres.
        n: Unit normals.
        footprint: Width of a pixel on the surface, metres.
    """
    fine = dr.select(mapped, dr.maximum(footprint, MAPPED_M), footprint)
    across = _find_surface_point(p, n)
    q = _turn_lattice(mi.Point2f(p.x, p.y))
    turned = mi.Vector3f(q.x, q.y, 0.0)

    def add(i: Any, tone: Any, hue: Any) -> tuple[Any, Any, Any]:
        row = 2 * (kind * MAX_OCTAVES + i)
        first = dr.gather(mi.Vector4f, octaves, row)
        second = dr.gather(mi.Vector4f, octaves, row + 1)
        plane = dr.select(second.z == 0.0, turned, mi.Vector3f(p))
        place = dr.select(second.w > 0.5, across, plane)
        at = place * mi.Vector3f(second.x, second.y, second.z) / first.z
        strength = retained_contrast(first.z, fine) * _space_noise(at, mi.Int32(first.w))
        return i + 1, tone + first.x * strength, hue + first.y * strength

    def goes_on(i: Any, *_: Any) -> Any:
        return i < MAX_OCTAVES

    start = (mi.UInt32(0), mi.Float(0.0), mi.Float(0.0))
    _, tone, hue = dr.while_loop(start, goes_on, add, labels=("i", "tone", "hue"))
    polish, worn = compute_wear(w, p, fine)
    uneven = 1.0 + 0.35 * value_noise(q / 3.0, 6)
    tone += dr.select(kind == int(Texture.ASPHALT), worn * uneven, 0.0)
    is_marking = kind == int(Texture.MARKING)
    tone -= dr.select(is_marking, 0.8 * _worn_paint(q, polish, fine), 0.0)
    is_leaf, is_crown = kind == int(Texture.LEAVES), kind == int(Texture.CROWN)
    leaves = _leaf_tones(p, LEAF_M, fine, 1)
    tone += dr.select(is_leaf | is_crown, 0.45 * leaves, 0.0)
    tone += dr.select(is_crown, 0.25 * _leaf_tones(p, BRANCH_M, fine, 3), 0.0)
    tone += _slab_tones(kind, mi.Point2f(across.x, across.y), n, fine, footprint)
    green, blue = mi.Float(0.25), mi.Float(-0.5)
    for texture in (Texture.GRASS, Texture.LEAVES, Texture.CROWN):
        # From fresh to withered: none is bluer than the mean.
        green = dr.select(kind == int(texture), 0.3, green)
        blue = dr.select(kind == int(texture), 0.5, blue)
    ratio = mi.Color3f(1.0 + tone + hue, 1.0 + tone + green * hue, 1.0 + tone + blue * hue)
    return dr.maximum(ratio, 0.0)


def _turn_lattice(p: Any) -> Any:
    """Turn points of the plane: roads run along the axes of many sites, and lattices must not."""
    return mi.Point2f(0.8 * p.x - 0.6 * p.y, 0.6 * p.x + 0.8 * p.y)


def _find_surface_point(p: Any, n: Any) -> Any:
    """Find the horizontal and upward coordinate on a surface; x and y on level ones."""
    slope = dr.sqrt(n.x * n.x + n.y * n.y)
    level = slope < LEVEL_SLOPE
    safe = dr.maximum(slope, 1e-6)
    right = (p.y * n.x - p.x * n.y) / safe
    return mi.Vector3f(dr.select(level, p.x, right), dr.select(level, p.y, p.z / safe), 0.0)


def _space_noise(p: Any, salt: Any) -> Any:
    """Evaluate noise between layers of the plane's."""
    layer = dr.floor(p.z)
    f = p.z - layer
    at, q = mi.Int32(layer) * 64 + salt, mi.Point2f(p.x, p.y)
    return dr.lerp(value_noise(q, at), value_noise(q, at + 64), f * f * (3.0 - 2.0 * f))


def _leaf_tones(p: Any, size: float, footprint: Any, salt: int) -> Any:
    """Evaluate the tone of the nearest leaf, of leaves strewn over a lattice, one in a cell.

    At the border to the next, both tones blend within the footprint.
    """
    q = p / size
    cell = dr.floor(q)
    first = mi.Vector3i(cell)
    nearest, other = mi.Vector3i(first), mi.Vector3i(first)
    away, other_away = mi.Float(1e3), mi.Float(1e3)
    for i in range(8):
        corner = (i & 1, (i >> 1) & 1, i >> 2)
        at = first + mi.Vector3i(*corner)
        bits = hash_bits(at.x, at.y, at.z * 64 + salt)
        place = mi.Vector3f(bits & 1023, (bits >> 10) & 1023, (bits >> 20) & 1023) / 1023.0
        own = dr.norm(mi.Vector3f(*corner) + LEAF_JITTER * (place - 0.5) - (q - cell))
        is_nearest, is_next = own < away, own < other_away
        other = dr.select(is_nearest, nearest, dr.select(is_next, at, other))
        other_away = dr.select(is_nearest, away, dr.select(is_next, own, other_away))
        nearest, away = dr.select(is_nearest, at, nearest), dr.select(is_nearest, own, away)
    tone, other_tone = (hash_cell(i.x, i.y, i.z * 64 + salt + 1) for i in (nearest, other))
    weight = 0.5 + (other_away - away) * size / dr.maximum(2.0 * footprint, 1e-6)
    return retained_contrast(2.0 * size, footprint) * dr.lerp(
        other_tone, tone, dr.clip(weight, 0.5, 1.0)
    )


def _cell_number(cell: Any, salt: int) -> Any:
    i = mi.Vector2i(cell)
    return hash_cell(i.x, i.y, salt)


def _worn_paint(p: Any, polish: Any, footprint: Any) -> Any:
    """Evaluate the wear of paint, most under tyres: 1 where asphalt shows, less the mean.

    Detail finer than the footprint blends.
    """
    mean, by_tyres, sharp, variance = 0.13, 0.35, 0.06, 0.184
    wavelength, weight, everything = 0.25, 0.1, 0.0
    total, lost = mi.Float(0.0), mi.Float(sharp**2)
    for octave in range(4):
        kept = retained_contrast(wavelength, footprint)
        total += weight * kept * value_noise(p / wavelength, 86 + octave)
        lost += variance * weight**2 * (1.0 - kept * kept)
        everything += variance * weight**2
        wavelength *= 0.36
        weight *= 1.6
        p = _turn_lattice(p)
    likely = dr.clip(mean + by_tyres * polish, 0.02, 0.9)
    at = float(np.sqrt(everything + sharp**2)) / LOGISTIC * dr.log(likely / (1.0 - likely))
    return 1.0 / (1.0 + dr.exp(-LOGISTIC * (total + at) / dr.sqrt(lost))) - mean


def _slab_tones(kind: Any, uv: Any, n: Any, fine: Any, footprint: Any) -> Any:
    """Evaluate the tones of slabs and cast panels, and the joints between them."""
    is_paving = kind == int(Texture.PAVING)
    upright = is_paving & (n.z < 0.5)
    level_size = dr.select(is_paving, mi.Float(1.5), 0.5)
    size = mi.Vector2f(
        dr.select(upright, mi.Float(4.0), level_size), dr.select(upright, mi.Float(2.0), level_size)
    )
    width = dr.select(is_paving, mi.Float(0.02), 0.01)
    tone = -0.45 * _joints(uv, size, width, footprint)
    pieces = retained_contrast(2.0 * dr.min(size), fine) * _cell_number(dr.floor(uv / size), 4)
    streaks = mi.Vector3f(uv.x / 0.5, uv.y * 0.12 / 0.5, 0.0)
    streaks = retained_contrast(0.5, fine) * _space_noise(streaks, mi.Int32(5))
    tone += dr.select(is_paving, 0.07 * pieces, 0.0) + dr.select(upright, 0.16 * streaks, 0.0)
    return dr.select(is_paving | (kind == int(Texture.SLABS)), tone, 0.0)


def _joints(uv: Any, size: Any, width: Any, footprint: Any) -> Any:
    """Evaluate joints between pieces: 1 in them, less the fraction of their area."""
    kept = retained_contrast(dr.min(size), footprint)
    soft = dr.maximum(footprint, 0.25 * width)
    place = mi.Vector2f(uv / size)
    off = dr.abs(place - dr.floor(place) - 0.5) * size
    edge = dr.clip((off - 0.5 * (size - width)) / soft + 0.5, 0.0, 1.0)
    mean = width / size
    covered = edge.x + edge.y - edge.x * edge.y
    return kept * (covered - (mean.x + mean.y - mean.x * mean.y))

"""Lamps of a frame on the device: their patterns, and their importance by place.

A surface draws a few lamps by their light at points of its cell of the ground, and one of those by
the illuminance of the point itself (resampled importance sampling, Talbot et al. 2005): hundreds of
lamps cost no more than a few. Every lamp has a chance everywhere.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from advercity.geometry.arrays import Float32Array, FloatArray
from advercity.physics.atmosphere import Atmosphere
from advercity.physics.lamp_beams import (
    BEAMS,
    LENS,
    LOW_BEAM,
    LampPattern,
    LightSource,
)
from advercity.physics.scattering import PhaseLobes
from advercity.rendering.backend import CameraView
from advercity.rendering.fog_beams import DROPLET_UM
from advercity.rendering.light_sources import FOG_LAMP_HEIGHT_M, LAMP_HEIGHT_M
from advercity_mitsuba.light import KILO, Light, look_up_fog_beam
from advercity_mitsuba.variant import dr, mi

LAMP_COLUMNS = 12
"""Numbers of a lamp: position and pattern, facing and squared size, peak in kcd and free path."""
GRID_CELLS, GRID_MARGIN_M = 64, 60.0
"""Cells along each edge of the ground with lamps, and the margin of the ground beyond them."""
POINTS_PER_EDGE, POINT_HEIGHTS_M = 2, (0.1, 1.5)
"""Points along each edge of a cell, and their heights, of which lamps have their chances."""
CANDIDATES = 4
"""Drawn lamps of a surface, of which it takes one."""
FOG_BEAM_LENGTH_M, LEAST_GLOW_CHANCE = 40.0, 1e-3
"""How long beams glow, and the chance of lamps whose glow hardly matters."""
FLOOR_FRACTION = 0.05
"""Fraction of the choices by intensities and distances alone."""
STREET_LAMP_HEIGHT_M = 6.0
LAMP_SIZE_M2, FOG_LAMP_SIZE_M2 = 0.01, 0.4
"""Squared size, nearer than which a lamp is not a point. A fog lamp represents two."""
GLOW_DRAWS = 24
"""Lamps of which a path has the glow in the air."""
LOBES = PhaseLobes.from_diameter_um(DROPLET_UM)
MAX_GAINED_DEPTH = 8.0
"""Optical depth beyond which halos gain no more by repeated deflection."""
LEAST_COSINE = 0.05
"""Cosine of incidence below which a lamp still has a chance: normals bend."""
FAR_M = 1e6
"""Length of the free path of unhidden lamps."""
HOUSING_M = 0.25
"""Metres around a lamp in which surfaces do not hide it."""


@dataclass(frozen=True, eq=False)
class LampTables:
    """Lamps on the device.

    Attributes:
        stride: Chances of a cell, a power of two: the number of lamps is no part of a kernel.
        lamps: `LAMP_COLUMNS` floats each.
        cells: Cumulative chance of each lamp by cell, and 1 beyond the last; the last row is for
            points off the grid.
        grid: Corner of the cells, and cells per metre.
    """

    stride: int
    lamps: Any
    cells: Any
    grid: Any


class LampSet:
    """The lamps of a frame."""

    def __init__(self, lamps: Sequence[LightSource], atmosphere: Atmosphere, light: Light) -> None:
        self._position = np.array([lamp.position for lamp in lamps]).reshape(-1, 3)
        self._facing = np.array([lamp.facing for lamp in lamps]).reshape(-1, 3)
        self._pattern = np.array([lamp.pattern for lamp in lamps], dtype=int)
        self._intensity_cd = np.array([lamp.intensity_cd for lamp in lamps])
        colour = np.array([lamp.colour for lamp in lamps]).reshape(-1, 3)
        self._extinction = atmosphere.extinction.at_550nm
        size = np.where(self._pattern == LampPattern.FOG_BEAM, FOG_LAMP_SIZE_M2, LAMP_SIZE_M2)
        peak = colour * self._intensity_cd[:, None] * KILO
        free_m = np.minimum([lamp.unobstructed_m for lamp in lamps], FAR_M)
        rows = np.column_stack([self._position, self._pattern, self._facing, size, peak, free_m])
        stride = 1 << len(lamps).bit_length()
        first, per_m = self._compute_grid()
        device_rows = mi.Float(rows.astype(np.float32).ravel())
        grid = mi.Vector4f(*map(float, (*first, *per_m)))
        dr.make_opaque(device_rows, grid)
        points = _list_cell_points(first, per_m)
        chances = _compute_chances(light, device_rows, len(lamps), points)
        off_grid = self._intensity_cd / self._intensity_cd.sum()
        cells = mi.Float(_accumulate(np.vstack([chances, off_grid]), stride).ravel())
        dr.make_opaque(cells)
        self.tables = LampTables(stride, device_rows, cells, grid)

    def _compute_grid(self) -> tuple[FloatArray, FloatArray]:
        """Compute the south-western corner (2,) of the cells, and cells per metre (2,)."""
        low = self._position[:, :2].min(axis=0) - GRID_MARGIN_M
        size = self._position[:, :2].max(axis=0) + GRID_MARGIN_M - low
        return low, GRID_CELLS / size

    def build_glow_chances(self, view: CameraView) -> Any:
        """Build the cumulative chances of lamps by their glow in the air of an image."""
        eye, ahead = view.world_from_camera[:3, 3], view.world_from_camera[:3, 0]
        # A beam glows along its length, so the nearest point of it counts.
        length = np.where(np.isin(self._pattern, list(BEAMS)), FOG_BEAM_LENGTH_M, 0.0)
        along = np.clip(((eye - self._position) * self._facing).sum(axis=1), 0.0, length)
        away = self._position + along[:, None] * self._facing - eye
        distance = np.maximum(np.linalg.norm(away, axis=1), 1.0)
        behind = np.maximum(0.0, -(away @ ahead))
        glow = self._intensity_cd * np.exp(-self._extinction * distance) / (distance + 3.0 * behind)
        glow = glow / glow.sum() + LEAST_GLOW_CHANCE
        chances = mi.Float(_accumulate(glow[None], self.tables.stride).ravel())
        dr.make_opaque(chances)
        return chances


def _list_cell_points(first: FloatArray, per_m: FloatArray) -> FloatArray:
    """List points (cells, points of each, 3) at even distances: x, y and height above ground."""
    edge = np.arange(GRID_CELLS * POINTS_PER_EDGE)
    cell, within = edge // POINTS_PER_EDGE, (edge % POINTS_PER_EDGE + 0.5) / POINTS_PER_EDGE
    x, y = (first[axis] + (cell + within) / per_m[axis] for axis in (0, 1))
    grid = np.stack(np.meshgrid(x, y, POINT_HEIGHTS_M), axis=-1)
    by_cell = grid.reshape(GRID_CELLS, POINTS_PER_EDGE, GRID_CELLS, -1, 3).swapaxes(1, 2)
    return by_cell.reshape(GRID_CELLS**2, -1, 3)


def _compute_chances(
    light: Light, device_rows: Any, lamp_count: int, points: FloatArray
) -> FloatArray:
    """Compute the chance of each lamp in each cell (cells, lamps).

    It is the mean, over the points of the cell, of its fraction of their light: no lamp is rare
    where it matters.
    """
    count = dr.opaque(mi.UInt32, lamp_count)
    number = dr.arange(mi.UInt32, points.size // 3 * lamp_count)
    place = mi.Float(points.astype(np.float32).ravel())
    dr.make_opaque(place)
    point = dr.gather(mi.Point3f, place, number // count)
    lamp = fetch_lamp(device_rows, number % count)
    # The ground under a lamp is assumed to be as high as under the point.
    is_street = lamp.pattern == int(LampPattern.STREET)
    point.z += lamp.position.z - dr.select(is_street, mi.Float(STREET_LAMP_HEIGHT_M), LAMP_HEIGHT_M)
    lux, _, distance = compute_illuminance(light, lamp, point)
    near = mi.luminance(lamp.peak) / (distance * distance + lamp.size_m2)
    size = *points.shape[:2], lamp_count
    lit, anyhow = (np.array(one).reshape(size) for one in (mi.luminance(lux), near))
    fraction, floor = (
        (one / np.maximum(one.sum(axis=2, keepdims=True), 1e-20)).mean(axis=1)
        for one in (lit, anyhow)
    )
    return fraction + FLOOR_FRACTION * floor


def _accumulate(weights: FloatArray, stride: int) -> Float32Array:
    """Sum weights (n, lamps) to cumulative chances (n, stride), 1 from the last lamp on."""
    chances = np.ones((len(weights), stride), np.float32)
    total = np.cumsum(weights, axis=1)
    chances[:, : weights.shape[1] - 1] = (total / total[:, -1:])[:, :-1]
    return chances


@dataclass
class Lamp:
    """One lamp at each point."""

    position: Any
    pattern: Any
    facing: Any
    size_m2: Any
    peak: Any
    unobstructed_m: Any


def fetch_lamp(lamps: Any, row: Any, active: Any = True) -> Lamp:
    """Fetch lamps from the table by their rows."""
    a, b, c = (dr.gather(mi.Vector4f, lamps, 3 * row + n, active) for n in range(3))
    return Lamp(
        mi.Point3f(a.x, a.y, a.z),
        mi.UInt32(a.w),
        mi.Vector3f(b.x, b.y, b.z),
        b.w,
        mi.Color3f(c.x, c.y, c.z),
        c.w,
    )


def is_beam(lamp: Lamp) -> Any:
    """Whether a lamp is a headlamp."""
    return (lamp.pattern != int(LampPattern.STREET)) & (lamp.pattern != int(LampPattern.LENS))


def compute_intensity_fraction(light: Light, lamp: Lamp, ray: Any, distance: Any) -> Any:
    """Compute the intensity along rays relative to the peak; `LampBeam` has the formulas."""
    depth = (1.0 - LOBES.wide_fraction) * light.extinction * distance
    beam = _compute_beam_fraction(lamp, ray, depth)
    cosine = dr.maximum(dr.dot(lamp.facing, ray), 0.0)
    base = 1.0 + (1.0 - cosine) / LENS.falloff
    lens = (base**-1.25 - LENS.at_right_angle) / (1.0 - LENS.at_right_angle)
    other = dr.select(lamp.pattern == int(LampPattern.LENS), lens, cosine)
    return dr.select(is_beam(lamp), beam, dr.maximum(other, 0.0))


def _compute_beam_fraction(lamp: Lamp, ray: Any, depth: Any) -> Any:
    def pick(name: str) -> Any:
        picked = mi.Float(getattr(LOW_BEAM, name))
        for pattern, beam in BEAMS.items():
            is_other = lamp.pattern == int(pattern)
            picked = dr.select(is_other, mi.Float(getattr(beam, name)), picked)
        return picked

    forward = dr.dot(ray, lamp.facing)
    level = dr.rsqrt(dr.maximum(lamp.facing.x**2 + lamp.facing.y**2, 1e-6))
    right = mi.Vector3f(lamp.facing.y * level, -lamp.facing.x * level, 0.0)
    h = dr.rad2deg(dr.atan2(dr.dot(ray, right), forward))
    v = dr.rad2deg(dr.asin(dr.clip(dr.dot(ray, dr.cross(right, lamp.facing)), -1.0, 1.0)))
    kink = dr.clip(pick("kink_slope") * h, 0.0, pick("kink_max_deg"))
    x = v + pick("cutoff_drop_deg") - kink
    aside = (h - pick("peak_right_deg")) / pick("horizontal_sigma_deg")
    sideways = dr.exp(-0.5 * aside * aside)
    above = dr.select(v > 0.0, dr.exp(-((v / pick("above_width_deg")) ** 2)), 1.0)
    below_peak = (x + pick("peak_below_cutoff_deg")) / pick("below_width_deg")
    below = dr.select(x < 0.0, dr.exp(-(below_peak**2)), 1.0)
    stray = pick("stray_fraction")
    dark = dr.exp(dr.clip(x / pick("cutoff_softness_deg"), -40.0, 40.0))
    sharp = (stray + (1.0 - stray) / (1.0 + dark)) * below * above
    # Droplets deflect a part of the light a little, which dissolves the cut-off.
    spread = dr.rad2deg(compute_forward_spread(depth))
    even = x - pick("even_top_deg")
    beyond = _fraction_beyond(even / spread)
    soft = beyond - _fraction_beyond((even + pick("equivalent_height_deg")) / spread)
    soft += stray * above * (1.0 - beyond)
    light = dr.lerp(soft, sharp, dr.exp(-depth))
    return dr.select(forward > 0.0, light * sideways, 0.0)


def compute_forward_spread(depth: Any) -> Any:
    """Compute the spread, in radians, of light deflected a little by droplets over a depth."""
    depth = dr.maximum(depth, 1e-3)
    return LOBES.narrow_scale_rad * depth / (1.0 - dr.exp(-depth))


def compute_deflection_density(angle: Any, spread: Any) -> Any:
    """Compute the density of deflections by an angle, without the angle's own factor."""
    spreads = angle / spread
    root = dr.sqrt(1.0 + spreads * spreads)
    return 1.0 / (spread * root * (root + spreads))


def _fraction_beyond(spreads: Any) -> Any:
    square = dr.maximum(spreads * spreads, 1e-12)
    return 0.5 - (dr.atan(spreads) + 0.5 * spreads * dr.log(1.0 + 1.0 / square)) / dr.pi


def compute_lamp_transmittance(light: Light, lamp: Lamp, distance: Any) -> Any:
    """Compute the fraction of a lamp's light left by fog.

    Street lamps shine all around and lose nothing: light scattered away from one point is scattered
    to it from others. Small deflections lose nothing either.
    """
    left = dr.exp(-LOBES.wide_fraction * light.extinction * distance)
    return dr.select(lamp.pattern == int(LampPattern.STREET), 1.0, left)


def compute_illuminance(light: Light, lamp: Lamp, position: Any) -> tuple[Any, Any, Any]:
    """Compute the light of lamps at points, on surfaces facing them.

    Returns:
        Illuminance in klx, the direction towards the lamp, and its distance.
    """
    to_lamp = lamp.position - position
    distance2 = dr.squared_norm(to_lamp)
    distance = dr.sqrt(dr.maximum(distance2, 1e-6))
    direction = to_lamp / distance
    fraction = compute_intensity_fraction(light, lamp, -direction, distance)
    left = compute_lamp_transmittance(light, lamp, distance)
    return lamp.peak * (fraction * left / (distance2 + lamp.size_m2)), direction, distance


def choose_lamp(
    light: Light, tables: LampTables, position: Any, normal: Any, random: Any, active: Any
) -> tuple[Any, Any, Any]:
    """Draw a lamp for points of surfaces.

    Returns:
        Its row, the inverse of its chance (0 where no candidate gives light), and the random
        numbers' next state.
    """
    cell = (mi.Point2f(position.x, position.y) - tables.grid.xy) * tables.grid.zw
    cell = mi.Vector2i(dr.floor(cell))
    inside = (cell.x >= 0) & (cell.y >= 0) & (cell.x < GRID_CELLS) & (cell.y < GRID_CELLS)
    row = dr.select(inside, mi.UInt32(cell.y * GRID_CELLS + cell.x), GRID_CELLS**2)
    first = row * tables.stride

    def draw(i: Any, random: Any, chosen: Any, given: Any, total: Any) -> tuple[Any, ...]:
        number = random.next_float32()
        row, chance = _draw_row(tables.cells, first, tables.stride, number, active)
        lux, direction, _ = compute_illuminance(
            light, fetch_lamp(tables.lamps, row, active), position
        )
        cosine = dr.maximum(dr.dot(normal, direction), LEAST_COSINE)
        gives = mi.luminance(lux) * cosine
        weight = dr.select(chance > 0.0, gives / chance, 0.0)
        total = total + weight
        is_taken = random.next_float32() * total < weight
        chosen, given = dr.select(is_taken, row, chosen), dr.select(is_taken, gives, given)
        return i + 1, random, chosen, given, total

    def goes_on(i: Any, *_: Any) -> Any:
        return active & (i < CANDIDATES)

    zero = mi.Float(0.0)
    _, random, chosen, given, total = dr.while_loop(
        (mi.UInt32(0), random, mi.UInt32(0), zero, zero),
        goes_on,
        draw,
        labels=("i", "random", "chosen", "given", "total"),
    )
    return chosen, dr.select(given > 0.0, total / (CANDIDATES * given), 0.0), random


def _evaluate_phase(cosine: Any) -> tuple[Any, Any]:
    """Evaluate the phase function of droplets: the parts of its narrow and its wide lobe."""
    narrow, wide, a = LOBES.narrow_g, LOBES.wide_g, LOBES.wide_a
    hg = (1.0 - narrow**2) / (1.0 + narrow**2 - 2.0 * narrow * cosine) ** 1.5
    draine = (1.0 - wide**2) / (1.0 + wide**2 - 2.0 * wide * cosine) ** 1.5
    draine *= (1.0 + a * cosine * cosine) / (1.0 + a * (1.0 + 2.0 * wide**2) / 3.0)
    each = 1.0 / (4.0 * math.pi)
    return LOBES.narrow_fraction * each * hg, LOBES.wide_fraction * each * draine


def compute_glow(
    light: Light, tables: LampTables, chances: Any, eye: Any, ray: Any, range_m: Any, random: Any
) -> tuple[Any, Any]:
    """Compute the light of lamps scattered into rays by the air.

    Each of some lamps has one point of the ray, drawn evenly in the cube root of the angle at the
    lamp: steps are short where the phase function is steep (equiangular sampling, Kulla and Fajardo
    2012). Beams have another one, for light scattered by fog before.

    Returns:
        Radiance, and the random numbers' next state.
    """
    first = random.next_float32()

    def add_lamp(i: Any, random: Any, total: Any) -> tuple[Any, Any, Any]:
        # Evenly spaced: the brightest are never left out.
        number = (mi.Float(i) + first) / GLOW_DRAWS
        row, chance = _draw_row(chances, mi.UInt32(0), tables.stride, number, mi.Bool(True))
        lamp = fetch_lamp(tables.lamps, row)
        glow = _compute_lamp_glow(light, lamp, eye, ray, range_m, random.next_float32())
        glow += _compute_diffuse_glow(light, lamp, eye, ray, range_m, random.next_float32())
        glow *= dr.select(chance > 0.0, 1.0 / (GLOW_DRAWS * chance), 0.0)
        return i + 1, random, total + glow

    def goes_on(i: Any, *_: Any) -> Any:
        return i < GLOW_DRAWS

    _, random, total = dr.while_loop(
        (mi.UInt32(0), random, mi.Color3f(0.0)),
        goes_on,
        add_lamp,
        labels=("i", "random", "total"),
    )
    return total, random


def _draw_row(chances: Any, first: Any, stride: int, number: Any, active: Any) -> tuple[Any, Any]:
    """Find the row of a random number among cumulative chances, and its chance."""

    def look_up(row: Any, active: Any) -> Any:
        return dr.gather(mi.Float, chances, first + row, active)

    def is_below(row: Any) -> Any:
        return look_up(row, active) <= number

    row = dr.binary_search(0, stride - 1, is_below)
    return row, look_up(row, active) - look_up(row - 1, active & (row > 0))


def _compute_lamp_glow(light: Light, lamp: Lamp, eye: Any, ray: Any, range_m: Any, u: Any) -> Any:
    """Compute the glow of one lamp from one point, by a random number.

    It is scattered once by the wide lobe, or as often as it meets droplets by the narrow one.
    """
    away = lamp.position - eye
    # The lamp lights only points before it.
    start, slope = -dr.dot(away, lamp.facing), dr.dot(ray, lamp.facing)
    crossing = -start / dr.select(dr.abs(slope) > 1e-6, slope, 1e-6)
    near = dr.select(slope > 0.0, dr.maximum(crossing, 0.0), 0.0)
    far = dr.select(slope > 0.0, range_m, dr.minimum(crossing, range_m))
    nearest = dr.dot(away, ray)
    closest = dr.maximum(dr.norm(away - nearest * ray), 0.02)
    first = dr.atan((near - nearest) / closest)
    span = dr.atan((far - nearest) / closest) - first
    tangent = dr.tan(first + span * u * u * u)
    sine = dr.rsqrt(1.0 + tangent * tangent)
    t, from_lamp = nearest + closest * tangent, closest / sine
    to_point = mi.Vector3f(eye + t * ray - lamp.position) / from_lamp
    narrow, wide = _evaluate_phase(-tangent * sine)
    path = light.extinction * (t + from_lamp)
    left, wide_left = dr.exp(-path), dr.exp(-LOBES.wide_fraction * path)
    gain = _compute_deflection_gain(light, away, ray)
    scattered = narrow * gain * left + wide * wide_left
    given = compute_intensity_fraction(light, lamp, to_point, from_lamp)
    size = from_lamp * from_lamp
    given *= size / (size + lamp.size_m2) * 3.0 * u * u * span / closest
    lit = (far > near) & (span > 0.0) & _is_unobstructed(lamp, to_point * from_lamp)
    return dr.select(lit, lamp.peak * (given * scattered * light.extinction), 0.0)


def _is_unobstructed(lamp: Lamp, from_lamp: Any) -> Any:
    """Whether points of the air are before the first vehicle in the beam of a lamp."""
    return dr.dot(from_lamp, lamp.facing) <= lamp.unobstructed_m


def _compute_deflection_gain(light: Light, away: Any, ray: Any) -> Any:
    """Compute all deflections by the narrow lobe into rays, relative to single ones."""
    distance = dr.norm(away)
    angle = dr.safe_acos(dr.dot(away, ray) / distance)
    depth = dr.maximum(LOBES.narrow_fraction * light.extinction * distance, 1e-3)
    often = compute_deflection_density(angle, compute_forward_spread(depth))
    often *= dr.exp(dr.minimum(depth, MAX_GAINED_DEPTH)) - 1.0
    return often / (depth * compute_deflection_density(angle, LOBES.narrow_scale_rad))


def _compute_diffuse_glow(
    light: Light, lamp: Lamp, eye: Any, ray: Any, range_m: Any, u: Any
) -> Any:
    """Compute the light scattered by fog out of a beam, and then into rays, from one point.

    Part of it goes along its flow, as much as the square of its mean cosine (delta scaling), and
    the rest is even. Points are even in the root of the air's opacity: most glows near the eye.
    """
    along = LOBES.wide_fraction * light.extinction
    opacity = 1.0 - dr.exp(-along * range_m)
    from_lamp = eye - dr.log(1.0 - opacity * u * u) / along * ray - lamp.position
    flow, fluence = _look_up_scattered(light, lamp, from_lamp)
    strength = dr.norm(flow)
    lit = is_beam(lamp) & (strength > 0.0) & _is_unobstructed(lamp, from_lamp)
    directed = dr.minimum(strength * strength / fluence, fluence)
    _, wide = _evaluate_phase(-dr.dot(flow, ray) / strength)
    turned = directed * wide / LOBES.wide_fraction + (fluence - directed) / (4.0 * math.pi)
    return dr.select(lit, lamp.peak * (2.0 * u * opacity * turned), 0.0)


def _look_up_scattered(light: Light, lamp: Lamp, from_lamp: Any) -> tuple[Any, Any]:
    """Look up flow and fluence of light scattered by fog and the road, per candela of the peak."""
    level = dr.rsqrt(dr.maximum(lamp.facing.x**2 + lamp.facing.y**2, 1e-6))
    x, y = lamp.facing.x * level, lamp.facing.y * level
    ahead, right = from_lamp.x * x + from_lamp.y * y, from_lamp.x * y - from_lamp.y * x
    is_fog_beam = lamp.pattern == int(LampPattern.FOG_BEAM)
    mounted = dr.select(is_fog_beam, mi.Float(FOG_LAMP_HEIGHT_M), LAMP_HEIGHT_M)
    up = dr.maximum(from_lamp.z + mounted, 0.0)
    root = dr.sign(ahead) * dr.sqrt(dr.abs(ahead)), dr.sqrt(dr.abs(right)), dr.sqrt(up)
    forward, aside, rising, fluence = look_up_fog_beam(light, is_fog_beam, root)
    aside = dr.select(right < 0.0, -aside, aside)
    return mi.Vector3f(forward * x + aside * y, forward * y - aside * x, rising), fluence

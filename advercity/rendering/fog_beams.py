"""Light of vehicles' beams scattered by fog, in the space around them.

Fog by night glows mostly with light scattered several times: most of the light returning to a
camera from its own beams has turned in two or three steps. Some ten thousand photons of a beam are
followed over level ground, and their flow and fluence recorded on a grid with fine cells near the
lamp. A seventh of the glow is light reflected by the road before any fog has scattered it; in clear
air there is no other, and it lights objects by the road. As everywhere by night, light deflected by
droplets within the narrow lobe counts as not scattered.
"""

import math
from functools import cache

import numpy as np
from numpy.typing import NDArray

from advercity.geometry.arrays import Float32Array, Float64Array, FloatArray
from advercity.physics.lamp_beams import FRONT_FOG_BEAM, LOW_BEAM, LampBeam
from advercity.physics.scattering import PhaseLobes
from advercity.physics.sky import GROUND_ALBEDO
from advercity.randomness import create_generator
from advercity.rendering.light_sources import FOG_LAMP_HEIGHT_M, FOG_LAMP_TILT_RAD, LAMP_HEIGHT_M

DROPLET_UM = 12.0
"""Droplet diameter of every fog by night, for renderers too; a weather's own is for daylight."""
FOG_BEAM_NODES = 24, 24, 24
"""Nodes of a table ahead of a lamp, to its right and up."""
LOW_CORNER_M, HIGH_CORNER_M = (-30.0, 0.0, 0.0), (120.0, 60.0, 40.0)
"""Extent of the grid: ahead of the lamp, to either side, and above the ground."""
PHOTONS, MAX_SCATTERINGS = 250_000, 12
MAX_PATH_M = 150.0
"""Distance beyond which no light returns."""
EXTINCTION_RATIO = 1.05
"""Ratio of neighbouring extinctions with tables of their own."""
BEAM_HALF_WIDTH_RAD, BEAM_BOTTOM_RAD, BEAM_TOP_RAD = np.radians([60.0, -14.0, 30.0])
"""Extent of the sampled beam to either side, down and up."""
STEP_HORIZONTAL_RAD, STEP_VERTICAL_RAD = np.radians([1.0, 0.1])
PHASE_STEPS = 4000

Generator = np.random.Generator


def compute_fog_beams(
    extinction_per_m: float, ground_albedo: float = GROUND_ALBEDO
) -> Float32Array:
    """Compute tables (beam, kind, nodes ahead, right, up, 4) of low beams and of front fog lamps.

    Each beam has a table of light scattered by fog, then one including the road's reflection.
    Values are flow ahead, to the right and up, and fluence, in 1/m² per candela of the peak. Nodes
    are evenly spaced between `grid_corners`. Takes three seconds of processor time.
    """
    step = round(math.log(max(extinction_per_m, 1e-6)) / math.log(EXTINCTION_RATIO))
    return _compute_tables(step, ground_albedo)


@cache
def _compute_tables(extinction_step: int, ground_albedo: float) -> Float32Array:
    wide_fraction = PhaseLobes.from_diameter_um(DROPLET_UM).wide_fraction
    extinction = wide_fraction * EXTINCTION_RATIO**extinction_step
    grids = [
        trace_beam(LOW_BEAM, LAMP_HEIGHT_M, 0.0, extinction, ground_albedo),
        trace_beam(FRONT_FOG_BEAM, FOG_LAMP_HEIGHT_M, FOG_LAMP_TILT_RAD, extinction, ground_albedo),
    ]
    return np.stack(grids)


def trace_beam(
    beam: LampBeam,
    height_m: float,
    tilt_rad: float,
    extinction_per_m: float,
    ground_albedo: float = GROUND_ALBEDO,
) -> Float32Array:
    """Trace light of a beam over level ground: flow and fluence (2, nodes ahead, right, up, 4).

    First of light scattered by fog, then of this and the road's reflection of unscattered light;
    direct light of the lamp is left out. The extinction coefficient belongs to the wide lobe.
    """
    generator = create_generator("sapien", "fog_beam", f"{height_m:g}", f"{extinction_per_m:.6g}")
    ray, lumens = _draw_rays(beam, tilt_rad, generator)
    start = np.zeros_like(ray)
    start[:, 2] = height_m
    # Each photon is scattered on its first segment, weighted by the scattered fraction.
    ground = _distance_to_ground(start, ray)
    ends = np.minimum(ground, MAX_PATH_M)
    scattered = -np.expm1(-extinction_per_m * ends)
    first = -np.log1p(-generator.random(len(ray)) * scattered) / extinction_per_m
    by_fog = _follow_photons(
        start + first[:, None] * ray,
        _scatter(ray, generator),
        lumens * scattered,
        extinction_per_m,
        ground_albedo,
        generator,
    )
    # Of light reaching the road unscattered, the fraction reflected by it.
    low = np.flatnonzero(ground < MAX_PATH_M)
    by_road = _follow_photons(
        start[low] + ground[low, None] * ray[low],
        _reflect(len(low), generator),
        ground_albedo * (lumens * (1.0 - scattered))[low],
        extinction_per_m,
        ground_albedo,
        generator,
    )
    return np.stack([by_fog, by_fog + by_road]).astype(np.float32)


def _follow_photons(
    position: Float64Array,
    ray: Float64Array,
    light: Float64Array,
    extinction_per_m: float,
    ground_albedo: float,
    generator: Generator,
) -> Float64Array:
    """Follow lumens (n,) from points along rays (n, 3): flow and fluence (nodes..., 4)."""
    grid = np.zeros((math.prod(FOG_BEAM_NODES), 4))
    for _ in range(MAX_SCATTERINGS):
        length = generator.exponential(1.0 / extinction_per_m, len(ray))
        ground = _distance_to_ground(position, ray)
        meets_ground = ground < length
        length = np.minimum(np.minimum(length, ground), MAX_PATH_M)
        # One point of a segment represents it, with the same expected value. Points are even
        # in the root of the distance: near the road, where much light begins, nodes are dense.
        root = generator.random(len(ray))
        passed = position + (root**2 * length)[:, None] * ray
        _add_to_grid(grid, passed, ray, light * length * 2.0 * root)
        position = position + length[:, None] * ray
        ray = np.where(
            meets_ground[:, None], _reflect(len(ray), generator), _scatter(ray, generator)
        )
        kept = (generator.random(len(ray)) < ground_albedo) | ~meets_ground
        kept &= np.linalg.norm(position, axis=1) < MAX_PATH_M
        position, ray, light = position[kept], ray[kept], light[kept]
    grid = grid.reshape(*FOG_BEAM_NODES, 4) / _node_volumes()[..., None]
    # Light ends softly where the grid does.
    grid[[0, -1]] = grid[:, -1] = grid[:, :, -1] = 0.0
    return grid


def _draw_rays(
    beam: LampBeam, tilt_rad: float, generator: Generator
) -> tuple[Float64Array, Float64Array]:
    """Draw unit rays (n, 3) in proportion to a beam's light, and the lumens (n,) of each.

    The peak is one candela; the axis is along x, tilted from the horizontal.
    """
    h = np.arange(-BEAM_HALF_WIDTH_RAD, BEAM_HALF_WIDTH_RAD, STEP_HORIZONTAL_RAD)
    v = np.arange(BEAM_BOTTOM_RAD, BEAM_TOP_RAD, STEP_VERTICAL_RAD)
    horizontal, vertical = (item.ravel() for item in np.meshgrid(h, v))
    rays = _unit_rays(horizontal, vertical)
    light = beam.relative_intensity(np.array([[1.0, 0.0, 0.0]]), rays[None])[0] * np.cos(vertical)
    cumulative = np.cumsum(light)
    drawn = np.searchsorted(
        cumulative, (np.arange(PHOTONS) + generator.random(PHOTONS)) / PHOTONS * cumulative[-1]
    )
    shift = generator.random((2, PHOTONS)) - 0.5
    rays = _unit_rays(
        horizontal[drawn] + shift[0] * STEP_HORIZONTAL_RAD,
        vertical[drawn] + shift[1] * STEP_VERTICAL_RAD - tilt_rad,
    )
    lumens = cumulative[-1] * STEP_HORIZONTAL_RAD * STEP_VERTICAL_RAD / PHOTONS
    return rays, np.full(PHOTONS, lumens)


def _unit_rays(left_rad: FloatArray, up_rad: FloatArray) -> Float64Array:
    level = np.cos(up_rad)
    return np.stack([level * np.cos(left_rad), level * np.sin(left_rad), np.sin(up_rad)], axis=-1)


def _distance_to_ground(position: Float64Array, ray: Float64Array) -> Float64Array:
    down = np.maximum(-ray[:, 2], 1e-9)
    return np.where(ray[:, 2] < 0.0, position[:, 2] / down, np.inf)


def _scatter(ray: Float64Array, generator: Generator) -> Float64Array:
    """Draw directions (n, 3) of light from rays (n, 3) after a scattering by the wide lobe."""
    cosine = np.cos(np.linspace(0.0, math.pi, PHASE_STEPS))
    phase = PhaseLobes.from_diameter_um(DROPLET_UM).wide_phase(cosine)
    cumulative = np.cumsum(phase * np.sqrt(1.0 - cosine**2))
    drawn = np.interp(generator.random(len(ray)) * cumulative[-1], cumulative, cosine)
    turn = generator.random(len(ray)) * 2.0 * math.pi
    # Two perpendicular vectors to a ray.
    helper = np.where(np.abs(ray[:, 2:]) < 0.9, [[0.0, 0.0, 1.0]], [[1.0, 0.0, 0.0]])
    across = np.cross(helper, ray)
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    other = np.cross(ray, across)
    sine = np.sqrt(1.0 - drawn**2)
    return (
        drawn[:, None] * ray
        + (sine * np.cos(turn))[:, None] * across
        + (sine * np.sin(turn))[:, None] * other
    )


def _reflect(count: int, generator: Generator) -> Float64Array:
    """Draw directions (n, 3) of light from Lambertian ground."""
    ray = generator.normal(size=(count, 3))
    ray /= np.linalg.norm(ray, axis=1, keepdims=True)
    ray[:, 2] += 1.0
    return ray / np.maximum(np.linalg.norm(ray, axis=1, keepdims=True), 1e-9)


def grid_corners() -> tuple[Float64Array, Float64Array]:
    """Compute the roots (3,) of the grid's corners: nodes are evenly spaced in roots of metres."""
    low, high = np.array(LOW_CORNER_M), np.array(HIGH_CORNER_M)
    return np.sign(low) * np.sqrt(np.abs(low)), np.sqrt(high)


def _add_to_grid(
    grid: Float64Array, position: Float64Array, ray: Float64Array, light: Float64Array
) -> None:
    """Add lumens times metres (n,) along rays (n, 3) to the nodes (nodes, 4) around points (n, 3).

    Beams are taken as symmetric: light on the left counts as on the right, mirrored.
    """
    low, high = grid_corners()
    right = np.stack([position[:, 0], np.abs(position[:, 1]), np.maximum(position[:, 2], 0.0)], 1)
    flow_right = np.where(position[:, 1] > 0.0, ray[:, 1], -ray[:, 1])
    root = np.sign(right) * np.sqrt(np.abs(right))
    nodes = np.array(FOG_BEAM_NODES)
    place = (root - low) / (high - low) * (nodes - 1)
    inside = np.flatnonzero(((place >= 0.0) & (place < nodes - 1)).all(axis=1))
    place = place[inside]
    flow = np.stack([ray[:, 0], flow_right, ray[:, 2], np.ones(len(ray))], axis=1)[inside]
    flow *= light[inside, None]
    first = place.astype(int)
    part = place - first
    for corner in np.ndindex(2, 2, 2):
        weight = np.where(np.array(corner) > 0, part, 1.0 - part).prod(axis=1)
        index = np.ravel_multi_index(tuple((first + corner).T), FOG_BEAM_NODES)
        for component in range(4):
            grid[:, component] += np.bincount(index, weight * flow[:, component], len(grid))


def _node_volumes() -> NDArray[np.float64]:
    """Compute the volumes (nodes ahead, right, up) of nodes in m³, both sides together."""
    low, high = grid_corners()
    lengths: list[Float64Array] = []
    for axis, count in enumerate(FOG_BEAM_NODES):
        fine = np.linspace(0.0, count - 1.0, (count - 1) * 64 + 1)
        root = low[axis] + (high[axis] - low[axis]) * fine / (count - 1)
        metres = np.diff(np.sign(root) * root**2)
        middle = (fine[1:] + fine[:-1]) / 2.0
        hat = np.maximum(1.0 - np.abs(middle - np.arange(count)[:, None]), 0.0)
        lengths.append(hat @ metres)
    ahead, right, up = lengths
    return 2.0 * ahead[:, None, None] * right[:, None] * up

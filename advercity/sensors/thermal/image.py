"""The image of a thermal camera, by rays against the same bodies as a LiDAR's.

Panes and paint mirror the sky and the surroundings. Values are apparent temperatures, of black
bodies, in steps of 0.04 K as in uncooled cameras (TLinear), 14 bits.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import cv2
import numpy as np
from advercity_dsl import ThermalCamera
from numpy.typing import NDArray

from advercity.frames import ActorState, Frame
from advercity.geometry.arrays import Float32Array, Float64Array, FloatArray, IndexArray
from advercity.geometry.poses import Matrix
from advercity.physics import water
from advercity.physics.infrared import band_radiance, brightness_temperature
from advercity.randomness import create_generator
from advercity.rendering.raycaster import Raycaster, RayHits, Rays
from advercity.semantics import Semantic
from advercity.sensors.camera_model import CameraModel
from advercity.sensors.measurements import KELVIN_PER_COUNT, MAX_COUNT
from advercity.sensors.thermal.conditions import ThermalConditions
from advercity.sensors.thermal.surface_heat import (
    IS_SMOOTH,
    compute_temperatures,
    warm_road_users,
)

MAX_RANGE_M = 3000.0
SHELTER_M = 60.0
"""Largest distance of shelter above a surface."""
NOISE_AT_K = 300.0
"""Temperature for the stated noise of cameras."""
WATER_MIRROR = 0.015
"""Reflectance of water facing the camera."""
_OFF_SURFACE_M = 0.01
_TILT = float(np.sqrt(0.5))
_SKY_DIRECTIONS = np.array(
    [(0, 0, 1), (_TILT, 0, _TILT), (-_TILT, 0, _TILT), (0, _TILT, _TILT), (0, -_TILT, _TILT)],
    np.float32,
)


@dataclass(frozen=True, eq=False)
class ThermalView:
    """Surfaces hit by the h times w rays of a thermal camera, without temperatures.

    Attributes:
        shape: (h, w).
        directions: (h * w, 3) float32 of the rays in the world.
        seen: (n,) numbers of the rays with a hit.
        hits: Their hits (n).
        points: (n, 3) float32 of the hits in the world.
        is_water: (n,) whether they are on standing water.
        sun_fraction: (n,) fraction of the sun on each hit.
        sky_fraction: (n,) fraction of the sky over each hit.
        mirrored: (n, 3) float32 mirrored directions of the rays.
        mirrors_sky: (n,) whether the mirrored ray reaches the sky.
    """

    shape: tuple[int, int]
    directions: Float32Array
    seen: IndexArray
    hits: RayHits
    points: FloatArray
    is_water: NDArray[np.bool_]
    sun_fraction: Float64Array
    sky_fraction: Float64Array
    mirrored: FloatArray
    mirrors_sky: NDArray[np.bool_]

    @property
    def instance(self) -> NDArray[np.int32]:
        """Ids (h, w) of the actors in pixels; 0 for everything static."""
        image = np.zeros(self.shape, np.int32)
        image.ravel()[self.seen] = self.hits.instance
        return image

    @property
    def semantic(self) -> NDArray[np.uint8]:
        """Classes (h, w) of `Semantic`."""
        image = np.full(self.shape, Semantic.SKY, np.uint8)
        image.ravel()[self.seen] = self.hits.semantic
        return image


def cast_thermal(
    model: CameraModel,
    world_from_camera: Matrix,
    frame: Frame,
    raycaster: Raycaster,
    conditions: ThermalConditions,
    *,
    hide: frozenset[int] = frozenset(),
) -> ThermalView:
    """Cast the rays of an image, and from their hits rays to the sun and the sky.

    Moving road users cast no shadow, as it is gone before a surface has cooled. Actors in `hide`
    are invisible to all rays.
    """
    directions = _build_directions(model, world_from_camera)
    origins = np.broadcast_to(world_from_camera[:3, 3].astype(np.float32), directions.shape)
    raycaster.place(frame, hide)
    met = raycaster.cast(Rays(np.ascontiguousarray(origins), directions), MAX_RANGE_M)
    seen = np.flatnonzero(np.isfinite(met.range_m))
    hits, ahead = met.select(seen), directions[seen]
    points = origins[seen] + hits.range_m[:, None] * ahead
    along = (ahead * hits.normal).sum(axis=1, keepdims=True)
    mirrored = ahead - 2.0 * along * hits.normal
    is_water = _find_puddles(hits, points, conditions)
    is_mirror = IS_SMOOTH[hits.material] | is_water
    raycaster.place(frame, hide | {item.actor.id for item in frame.states if not item.is_parked})
    shelter = _Shelter(raycaster, points + np.float32(_OFF_SURFACE_M) * hits.normal)
    sun = conditions.sun_direction.astype(np.float32)
    faces_sun = (hits.normal @ sun > 0.0) & (conditions.sun_w_m2 > 0.0)
    is_up = is_mirror & (mirrored[:, 2] > 0.0)
    return ThermalView(
        shape=(model.height_px, model.width_px),
        directions=directions,
        seen=seen,
        hits=hits,
        points=points,
        is_water=is_water,
        sun_fraction=shelter.find_open(np.flatnonzero(faces_sun), sun, MAX_RANGE_M),
        sky_fraction=_find_sky_fraction(hits.normal, shelter),
        mirrored=mirrored,
        mirrors_sky=shelter.find_open(np.flatnonzero(is_up), mirrored[is_up], SHELTER_M) > 0.0,
    )


def take_thermal_image(
    camera: ThermalCamera,
    view: ThermalView,
    conditions: ThermalConditions,
    states: Iterable[ActorState],
    rng: np.random.Generator,
    *,
    seed: int,
    name: str,
) -> NDArray[np.uint16]:
    """Compute the values (h, w) of an image.

    Args:
        camera: The camera.
        view: Surfaces hit by its rays.
        conditions: The weather.
        states: All actors.
        rng: Noise of this image.
        seed: Seed of the camera's pattern and of the times since cars were parked.
        name: Name of the camera; each has its own pattern.
    """
    radiance = _compute_radiance(view, conditions, {one.actor.id: one for one in states}, seed)
    if camera.blur_px:
        radiance = cv2.GaussianBlur(radiance, (0, 0), camera.blur_px)
    per_kelvin = float(band_radiance(NOISE_AT_K + 0.5) - band_radiance(NOISE_AT_K - 0.5))
    noise_k = camera.netd_mk * 1e-3 * rng.standard_normal(view.shape)
    lasting = create_generator(seed, "thermal pattern", name)
    pattern = lasting.standard_normal(view.shape) + lasting.standard_normal(view.shape[1])
    noise_k += camera.fixed_pattern_mk * 1e-3 * pattern
    kelvin = brightness_temperature(radiance + per_kelvin * noise_k)
    return np.clip(np.rint(kelvin / KELVIN_PER_COUNT), 0, MAX_COUNT).astype(np.uint16)


def _compute_radiance(
    view: ThermalView,
    conditions: ThermalConditions,
    states: Mapping[int, ActorState],
    seed: int,
) -> Float64Array:
    """Compute the radiance (h, w) at the pixels, W/(m² sr)."""
    air, hits = conditions.air, view.hits
    image = air.sky_radiance(view.directions[:, 2].astype(np.float64))
    temperature, emissivity = compute_temperatures(
        hits, conditions, view.sun_fraction, view.sky_fraction
    )
    warm_road_users(temperature, hits, view.points, states, conditions, seed=seed)
    mirrors = IS_SMOOTH[hits.material] | view.is_water
    facing = np.where(view.is_water, WATER_MIRROR, 1.0 - emissivity)
    reflectance = np.where(mirrors, _compute_schlick(facing, hits.cosine), 1.0 - emissivity)
    sky = air.sky_radiance(np.maximum(view.mirrored[:, 2], 0.0).astype(np.float64))
    ambient = band_radiance(air.air_k)
    mirrored = np.where(view.mirrors_sky, sky, ambient)
    diffuse = ambient + view.sky_fraction * (air.sky_radiance(np.array(_TILT)) - ambient)
    around = np.where(mirrors, mirrored, diffuse)
    radiance = (1.0 - reflectance) * band_radiance(temperature) + reflectance * around
    image[view.seen] = air.see_through(radiance, hits.range_m.astype(np.float64))
    return image.reshape(view.shape)


def _compute_schlick(facing: Float64Array, cosine: FloatArray) -> Float64Array:
    """Compute the reflectance (n,) from the one at normal incidence (Schlick 1994)."""
    return facing + (1.0 - facing) * (1.0 - np.minimum(cosine, 1.0)) ** 5


def _find_puddles(
    hits: RayHits, points: FloatArray, conditions: ThermalConditions
) -> NDArray[np.bool_]:
    """Find the hits (n,) on standing water."""
    on_road = (hits.semantic == Semantic.ROAD) | (hits.semantic == Semantic.ROAD_LINE)
    if not conditions.puddle_coverage:
        return np.zeros(len(points), np.bool_)
    on_road &= hits.keep_exposed(hits.normal[:, 2]) > 0.9
    on_road[on_road] = water.is_in_puddle(points[on_road], conditions.puddle_coverage)
    return on_road


def _find_sky_fraction(normal: FloatArray, shelter: "_Shelter") -> Float64Array:
    """Find the visible part of the sky (n,) for surfaces: 1 for level ground in the open."""
    weights = np.maximum(normal @ _SKY_DIRECTIONS.T, 0.0).astype(np.float64)
    is_open = np.zeros_like(weights)
    for column, direction in enumerate(_SKY_DIRECTIONS):
        rows = np.flatnonzero(weights[:, column] > 0.0)
        is_open[:, column] = shelter.find_open(rows, direction, SHELTER_M)
    total = np.maximum(weights.sum(axis=1), 1e-6)
    return (1.0 + normal[:, 2]) / 2.0 * (weights * is_open).sum(axis=1) / total


@dataclass(frozen=True, eq=False)
class _Shelter:
    """Finds surfaces with a free path in some direction.

    Attributes:
        raycaster: Raycaster with the actors that cast shadows.
        starts: (n, 3) float32 just above the surfaces.
    """

    raycaster: Raycaster
    starts: FloatArray

    def find_open(self, rows: IndexArray, directions: FloatArray, range_m: float) -> Float64Array:
        """Return 1 for surfaces of `rows` open in a direction (3,), or (k, 3); 0 for all others."""
        found = np.zeros(len(self.starts))
        if len(rows):
            towards = np.ascontiguousarray(np.broadcast_to(directions, (len(rows), 3)), np.float32)
            met = self.raycaster.cast(Rays(self.starts[rows], towards), range_m)
            found[rows] = np.isinf(met.range_m)
        return found


def _build_directions(model: CameraModel, world_from_camera: Matrix) -> Float32Array:
    """Build the directions (h * w, 3) of the middles of the pixels, row by row."""
    down, right = np.indices((model.height_px, model.width_px)) + 0.5
    left, up = (model.width_px / 2 - right), (model.height_px / 2 - down)
    ahead = np.full(left.shape, model.focal_px)
    directions = np.stack([ahead, left, up], axis=-1).reshape(-1, 3)
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    return (directions @ world_from_camera[:3, :3].T).astype(np.float32)

"""Temperatures of surfaces: by sun, sky and air, by bodies, and by engines.

The temperature over the air's is ASHRAE's sol-air excess, (a G - e dR) / h. A material takes a part
of it at once and keeps a part of the day's mean. a is its absorptance of sunlight, G the
irradiance, e its emissivity, dR the loss to the sky, h the heat to the air per kelvin.
"""

import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from advercity.frames import ActorState
from advercity.geometry import poses
from advercity.geometry.arrays import Float64Array, FloatArray, IndexArray
from advercity.materials import MATERIALS
from advercity.physics.infrared import ZERO_CELSIUS_K
from advercity.physics.photometry import LUMINANCE_WEIGHTS
from advercity.randomness import create_generator
from advercity.rendering.raycaster import MATERIAL_NAMES, RayHits
from advercity.semantics import Semantic
from advercity.sensors.thermal.conditions import ThermalConditions

_ROWS = [MATERIALS[name] for name in MATERIAL_NAMES]
EMISSIVITY = np.array([row.thermal.emissivity for row in _ROWS])
SMOOTH_ROUGHNESS = 0.3
"""Roughness in the visible up to which a surface mirrors in the infrared."""
IS_SMOOTH = np.array([row.roughness <= SMOOTH_ROUGHNESS for row in _ROWS])
_SUN_RESPONSE = np.array([row.thermal.sun_response for row in _ROWS])
_STORED = np.array([row.thermal.stored for row in _ROWS])
_VISIBLE = np.array([row.albedo for row in _ROWS]) @ LUMINANCE_WEIGHTS
# Half of sunlight is visible, half is infrared.
_ABSORPTANCE = 1.0 - (_VISIBLE + np.array([row.reflectance_905nm for row in _ROWS])) / 2.0


def _is_named(*beginnings: str) -> NDArray[np.bool_]:
    return np.array([name.startswith(beginnings) for name in MATERIAL_NAMES])


_IS_SKIN = _is_named("skin")
_IS_HAIR = _is_named("hair_")
_IS_CLOTH = _is_named("cloth_", "leather")
_IS_RUBBER, _IS_GLASS = _is_named("rubber"), _is_named("glass")
_IS_WHEEL_METAL = _is_named("metal", "chrome")

GROUND_REFLECTANCE = 0.2
"""Reflectance of the surroundings for sunlight, part of which reaches walls."""
DRIED_BY_WATER = 0.85
"""Part of a surface's excess lost to evaporation of a film of water."""
SNOW_EMISSIVITY = 0.985
BODY_HEAT_W_M2 = 90.0
"""Heat of a walking person through its clothes: 60 W/m² go with breath and sweat (ISO 8996)."""
HAIR_FACTOR = 1.5
"""Heat through hair relative to heat through clothes."""
SKIN_C, SKIN_AT_C, SKIN_PER_K, MIN_SKIN_C = 33.0, 22.0, 0.35, 18.0
"""Temperature of faces and hands in air of `SKIN_AT_C`, its change per kelvin of the air, and its
minimum: between the cheeks' and the forehead's in the cold."""
PARKED_MEAN_H, COOLING_H = 3.0, 0.7
"""Mean time since a parked car was driven, and the time in which it cools to 1/e: assumptions."""
BONNET_K, GRILLE_K, CABIN_K, TYRE_K, BRAKE_K, UNDERSIDE_K = 12.0, 18.0, 3.0, 12.0, 25.0, 20.0
EXHAUST_K, MOTORCYCLE_ENGINE_K = 70.0, 50.0
"""Excesses of parts of a vehicle after a long drive, of the size seen in thermograms."""
EXHAUST_HEIGHT_M, EXHAUST_SPREAD_M = 0.32, 0.06
"""Height of an exhaust's end above the road, and the radius of the warm bumper around it."""


def compute_temperatures(
    hits: RayHits,
    conditions: ThermalConditions,
    sun_fraction: Float64Array,
    sky_fraction: Float64Array,
) -> tuple[Float64Array, Float64Array]:
    """Compute temperatures (n,) in kelvin of surfaces by the weather, and their emissivities.

    Args:
        hits: The surfaces, without misses.
        conditions: The weather.
        sun_fraction: (n,) fraction of the sun on them, 0 in a shadow.
        sky_fraction: (n,) fraction of the sky over them, 1 for level ground in the open.
    """
    air = conditions.air
    material, transfer = hits.material, conditions.transfer_w_m2_k
    level_w_m2 = conditions.diffuse_w_m2 + conditions.sun_w_m2 * max(
        0.0, float(conditions.sun_direction[2])
    )
    facing = np.clip(hits.normal @ conditions.sun_direction, 0.0, 1.0)
    irradiance = (
        conditions.sun_w_m2 * facing * sun_fraction
        + conditions.diffuse_w_m2 * sky_fraction
        + GROUND_REFLECTANCE * level_w_m2 * (1.0 - sky_fraction)
    )
    absorptance, stored = _ABSORPTANCE[material], _STORED[material]
    by_sun = absorptance * irradiance / transfer * _SUN_RESPONSE[material]
    kept = stored * absorptance * conditions.mean_w_m2 * sky_fraction / transfer
    # Walls see as much warm ground as cold sky: ASHRAE has no loss for them.
    open_sky = np.maximum(0.0, 2.0 * sky_fraction - 1.0)
    cooling = EMISSIVITY[material] * air.longwave_loss_w_m2 * open_sky / transfer
    excess = by_sun + kept - cooling * (1.0 - stored)
    upward = np.clip(hits.normal[:, 2], 0.0, 1.0)
    excess *= 1.0 - DRIED_BY_WATER * conditions.wetness * np.maximum(upward, 0.5)
    temperature, emissivity = air.air_k + excess, EMISSIVITY[material]
    if conditions.snow_cover or conditions.road_snow_cover:
        snow_k = np.minimum(ZERO_CELSIUS_K, air.air_k - cooling)
        cover = upward * _find_snow_cover(hits, conditions)
        temperature = temperature + cover * (snow_k - temperature)
        emissivity = emissivity + cover * (SNOW_EMISSIVITY - emissivity)
    return temperature, emissivity


def _find_snow_cover(hits: RayHits, conditions: ThermalConditions) -> Float64Array:
    """Find the fraction (n,) of level surfaces under snow; road users have none."""
    on_road = (hits.semantic == Semantic.ROAD) | (hits.semantic == Semantic.ROAD_LINE)
    cover = np.array([conditions.snow_cover, conditions.road_snow_cover]).take(on_road)
    return hits.keep_exposed(np.where(hits.instance > 0, 0.0, cover))


def warm_road_users(
    temperature: Float64Array,
    hits: RayHits,
    points: FloatArray,
    states: Mapping[int, ActorState],
    conditions: ThermalConditions,
    *,
    seed: int,
) -> None:
    """Add the heat of bodies and engines to temperatures (n,) of surfaces at points (n, 3)."""
    for number in np.unique(hits.instance[hits.instance > 0]).tolist():
        rows, state = np.flatnonzero(hits.instance == number), states[number]
        body_from_world = poses.invert_pose(state.world_from_body)
        if state.actor.actor_class in ("pedestrian", "bicycle", "motorcycle"):
            _warm_person(temperature, rows, hits.material[rows], conditions)
        if state.actor.actor_class in ("pedestrian", "bicycle"):
            continue
        place = poses.transform_points(body_from_world, points[rows])
        normal = hits.normal[rows] @ body_from_world[:3, :3].T
        excess = _compute_engine_excess(state, place, normal, hits.material[rows])
        temperature[rows] += find_warmth(state, seed=seed) * excess


def find_warmth(state: ActorState, *, seed: int) -> float:
    """Find the warmth of a vehicle: 1 if it drives, less the longer it has been parked."""
    if not state.is_parked:
        return 1.0
    parked_h = create_generator(seed, "parked for", state.actor.id).exponential(PARKED_MEAN_H)
    return math.exp(-float(parked_h) / COOLING_H)


def _warm_person(
    temperature: Float64Array,
    rows: IndexArray,
    material: NDArray[np.int16],
    conditions: ThermalConditions,
) -> None:
    air_c = conditions.air.air_k - ZERO_CELSIUS_K
    through_clothes = BODY_HEAT_W_M2 / conditions.transfer_w_m2_k
    temperature[rows[_IS_CLOTH[material]]] += through_clothes
    temperature[rows[_IS_HAIR[material]]] += HAIR_FACTOR * through_clothes
    skin_c = max(MIN_SKIN_C, air_c, SKIN_C + SKIN_PER_K * (air_c - SKIN_AT_C))
    temperature[rows[_IS_SKIN[material]]] = skin_c + ZERO_CELSIUS_K


def _compute_engine_excess(
    state: ActorState, place: FloatArray, normal: FloatArray, material: NDArray[np.int16]
) -> Float64Array:
    """Compute the excess (n,) in kelvin of a driven vehicle at points (n, 3) in its frame."""
    length, width, height = state.actor.size
    ahead, beside, up = place[:, 0] / length, np.abs(place[:, 1]) / width, place[:, 2]
    if state.actor.actor_class == "motorcycle":
        is_engine = (np.abs(ahead) < 0.2) & (up > 0.2) & (up < 0.65)
        return np.where(is_engine & ~_IS_CLOTH[material], MOTORCYCLE_ENGINE_K, 0.0)
    excess = np.where(_IS_GLASS[material], CABIN_K, 0.0)
    excess[_IS_RUBBER[material]] += TYRE_K
    excess[_IS_WHEEL_METAL[material] & (beside > 0.35) & (up < 0.6)] += BRAKE_K
    if state.actor.towed_by:
        return excess  # the engine is in the tractor unit
    is_body = ~_IS_GLASS[material] & ~_IS_RUBBER[material]
    is_bonnet = is_body & (ahead > 0.22) & (normal[:, 2] > 0.5) & (up < 0.75 * height)
    is_grille = is_body & (ahead > 0.45) & (normal[:, 0] > 0.5) & (beside < 0.35)
    # Bonnets are warm in their middle, above the engine.
    excess[is_bonnet] += BONNET_K * np.clip(1.2 - 1.6 * beside[is_bonnet], 0.0, 1.0)
    excess[is_grille & (up > 0.25) & (up < 0.85)] += GRILLE_K
    excess[is_body & (normal[:, 2] < -0.3)] += UNDERSIDE_K
    side = 1.0 if state.actor.id % 2 else -1.0
    off_m = np.hypot(place[:, 1] - side * 0.3 * width, up - EXHAUST_HEIGHT_M)
    spot = np.exp(-0.5 * (off_m / EXHAUST_SPREAD_M) ** 2)
    excess += np.where(is_body & (ahead < -0.46), EXHAUST_K * spot, 0.0)
    return excess

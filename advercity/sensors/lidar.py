"""A spinning LiDAR: its beams, what comes back through the air, and the points it reports.

Points are in the LiDAR's own frame, right-handed, x forward, y left, z up. One turn sees one
instant: beams turn counter-clockwise from straight ahead, all channels at each azimuth.
"""

import math
from dataclasses import dataclass

import numpy as np
from advercity_dsl import Lidar
from numpy.typing import NDArray

from advercity.poses import Matrix
from advercity.rendering.casting import MATERIAL_NAMES, Caster, Hits
from advercity.weather.atmosphere import Atmosphere
from advercity.weather.extinction import of_visibility
from advercity.world.materials import MATERIALS

Array = NDArray[np.float64]

NEAR_FIELD_M = 10.0
"""Below this range gain control and overlap keep echoes from growing with 1/R²."""
REFERENCE_REFLECTANCE = 0.10
REFERENCE_RANGE_M = 80.0
"""Where a target of 10 % facing the sensor in clear air is detected half the time."""
REFERENCE_VISIBILITY_M = 20_000.0
SIGNAL_TO_NOISE = 5.0
"""Of an echo at the detection threshold."""
WATER_INDEX = 1.328
"""Refractive index of water at 905 nm."""
_INTERNAL_REFLECTANCE = 0.4702
_CARLA_ATTENUATION_PER_M = 0.004
_REFLECTANCE = np.array([MATERIALS[name].reflectance_905nm for name in MATERIAL_NAMES])


@dataclass(frozen=True, eq=False)
class PointCloud:
    """What one turn reports, n points.

    Attributes:
        points: (n, 3) float32, metres, LiDAR frame.
        intensity: (n,) float32 from 0 to 1: reflectance times cosine, dimmed by the air.
        ring: (n,) uint16 channel, from the lowest up.
        range_m: (n,) float32, noise included.
        semantic: (n,) uint8 of `Semantic`.
        instance: (n,) int32 id of the actor; 0 for everything static.
    """

    points: NDArray[np.float32]
    intensity: NDArray[np.float32]
    ring: NDArray[np.uint16]
    range_m: NDArray[np.float32]
    semantic: NDArray[np.uint8]
    instance: NDArray[np.int32]


def elevations_rad(lidar: Lidar) -> Array:
    """Elevation of every channel (channels,), from the lowest up."""
    return np.radians(np.linspace(lidar.lower_deg, lidar.upper_deg, lidar.channels))


def beams(lidar: Lidar) -> Array:
    """Directions (azimuths * channels, 3) of one turn, unit vectors in the LiDAR frame."""
    azimuth = np.arange(lidar.azimuths)[:, None] * (2.0 * math.pi / lidar.azimuths)
    elevation = elevations_rad(lidar)[None, :]
    level = np.cos(elevation)
    parts = np.broadcast_arrays(level * np.cos(azimuth), level * np.sin(azimuth), np.sin(elevation))
    return np.stack(parts, axis=-1).reshape(-1, 3)


def shoot(lidar: Lidar, world_from_lidar: Matrix, caster: Caster) -> Hits:
    """What every beam of one turn meets, in the order of `beams`, whatever the weather."""
    directions = beams(lidar) @ world_from_lidar[:3, :3].T
    origins = np.broadcast_to(world_from_lidar[:3, 3], directions.shape)
    return caster.cast(origins, directions, lidar.range_m)


def visible_counts(hits: Hits) -> dict[int, int]:
    """Beams that meet each actor, by its id: the original's test of who is annotated."""
    actors, counts = np.unique(hits.instance[hits.instance > 0], return_counts=True)
    return dict(zip(actors.tolist(), counts.tolist(), strict=True))


def sweep(lidar: Lidar, hits: Hits, atmosphere: Atmosphere, rng: np.random.Generator) -> PointCloud:
    """The points that come out of one turn's `hits` in this weather.

    An echo is reported if it and the receiver's noise together pass the threshold, and if the
    rig's drop-off spares it.
    """
    count = len(hits.range_m)
    fired = rng.random(count) >= lidar.dropoff_rate
    receiver_noise = rng.standard_normal(count)
    range_noise = rng.standard_normal(count) * lidar.range_noise_m
    spared = rng.random(count)

    met = np.flatnonzero(np.isfinite(hits.range_m) & fired)
    true_range = hits.range_m[met].astype(np.float64)
    reflected = reflected_share(hits, atmosphere.wetness)[met]
    extinction = atmosphere.extinction_905nm
    margin = detection_margin(echo(true_range, reflected, extinction))
    range_m = true_range + range_noise[met]
    reported = (receiver_noise[met] < margin) & (spared[met] < keep_share(lidar, range_m))

    kept, range_m = met[reported], range_m[reported]
    intensity = reflected[reported] * np.exp(-2.0 * extinction * true_range[reported])
    return PointCloud(
        points=(beams(lidar)[kept] * range_m[:, None]).astype(np.float32),
        intensity=np.clip(intensity, 0.0, 1.0).astype(np.float32),
        ring=(kept % lidar.channels).astype(np.uint16),
        range_m=range_m.astype(np.float32),
        semantic=hits.semantic[kept],
        instance=hits.instance[kept],
    )


def echo(range_m: Array, reflected: Array, extinction_905nm: float) -> Array:
    """Received power of a hard target, normalised: LiDAR equation, Lambertian target.

    Args:
        range_m: (n,) metres.
        reflected: (n,) reflectance times cosine of incidence.
        extinction_905nm: Of the air between, 1/m.
    """
    gain = 1.0 / (range_m**2 + NEAR_FIELD_M**2)
    return reflected / math.pi * np.exp(-2.0 * extinction_905nm * range_m) * gain


def detection_margin(power: Array) -> Array:
    """How far (n,) an echo stands above the threshold, in standard deviations of the noise."""
    threshold = echo(
        np.array(REFERENCE_RANGE_M),
        np.array(REFERENCE_REFLECTANCE),
        of_visibility(REFERENCE_VISIBILITY_M),
    )
    return SIGNAL_TO_NOISE * (power / threshold - 1.0)


def reflected_share(hits: Hits, wetness: float) -> Array:
    """Reflectance at 905 nm times cosine of incidence (n,), lower where water lies on top.

    Rain leaves its film on what faces up; walls and windows stay as they are.
    """
    reflectance = _REFLECTANCE[hits.material]
    cosine = hits.cosine.astype(np.float64)
    film = wetness * np.clip(hits.normal[:, 2], 0.0, 1.0)
    return reflectance * cosine * (1.0 + film * (wet_factor(reflectance, cosine) - 1.0))


def wet_factor(reflectance: Array, cosine: Array) -> Array:
    """Echo (n,) of a target under a film of water against the same target dry.

    Light crosses the surface twice and is partly held inside (Angstrom 1925; Lekner and Dorf
    1988); at grazing incidence most of it glances off.
    """
    passed = 1.0 - fresnel(cosine, WATER_INDEX)
    return passed**2 / (WATER_INDEX**2 * (1.0 - reflectance * _INTERNAL_REFLECTANCE))


def fresnel(cosine: Array, index: float) -> Array:
    """Share (n,) of unpolarised light that a smooth surface of that refractive index reflects."""
    refracted = np.sqrt(1.0 - (1.0 - cosine**2) / index**2)
    across = (cosine - index * refracted) / (cosine + index * refracted)
    along = (index * cosine - refracted) / (index * cosine + refracted)
    return (across**2 + along**2) / 2.0


def keep_share(lidar: Lidar, range_m: Array) -> Array:
    """Share (n,) of echoes that the rig's intensity drop-off spares.

    CARLA's rule, on the intensity that CARLA knows: exp(-0.004 R), without target or weather.
    """
    intensity = np.exp(-_CARLA_ATTENUATION_PER_M * range_m)
    weakness = np.maximum(0.0, 1.0 - intensity / max(lidar.dropoff_intensity_limit, 1e-9))
    return 1.0 - lidar.dropoff_zero_intensity * weakness

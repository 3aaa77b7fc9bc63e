"""The points that come out of one turn of a LiDAR in the weather."""

import math
from typing import Any

import numpy as np
from advercity_dsl import Lidar
from numpy.typing import NDArray

from advercity.sensors.lidar.air import LidarAir
from advercity.sensors.lidar.beams import beams
from advercity.sensors.lidar.cloud import PointCloud
from advercity.sensors.lidar.draws import Draws, Purpose
from advercity.sensors.lidar.echoes import Echoes, reported
from advercity.sensors.lidar.power import (
    apparent_reflectance,
    range_deviation_m,
)
from advercity.sensors.lidar.scanning import Scan, turn_shares
from advercity.sensors.lidar.sources import Sources, noise_of
from advercity.sensors.lidar.window import SECTORS, Window
from advercity.traffic.trace import ActorState

Floats = NDArray[np.floating[Any]]

TURN_S = 0.1
SUN_BLINDS_RAD = math.radians(1.0)
_CARLA_ATTENUATION_PER_M = 0.004


def sweep(
    lidar: Lidar,
    scan: Scan,
    air: LidarAir,
    rng: np.random.Generator,
    *,
    states: tuple[ActorState, ...] = (),
) -> PointCloud:
    """What a LiDAR reports of one turn's `scan` in this air.

    Surfaces, what is behind windows or mirrored in puddles, fog, dust, drops, flakes and spray
    all send light back. Echoes of a beam that overlap are one; those that pass the receiver's
    threshold are candidates, of which the rig has the strongest, the last or both reported.

    Args:
        lidar: The sensor.
        scan: What its rays met.
        air: The weather.
        rng: Of this sensor and frame.
        states: Who may throw up spray.
    """
    draws = Draws(rng)
    window = Window.of(lidar, air.window_coverage)
    sources = Sources(lidar, scan, air, draws, window=window, states=states)
    fired = _fired(lidar, scan, air, draws, window)
    rivals, others = _parts(lidar, sources, fired)
    found = reported(rivals, others, lidar.azimuths * lidar.channels, lidar.echoes)
    return _cloud(lidar, scan, air, draws, found)


def keep_share(lidar: Lidar, range_m: Floats) -> Floats:
    """Share (n,) of echoes that the rig's intensity drop-off spares.

    CARLA's rule, on the intensity that CARLA knows: exp(-0.004 R), without target or weather.
    """
    intensity = np.exp(-_CARLA_ATTENUATION_PER_M * range_m)
    weakness = np.maximum(0.0, 1.0 - intensity / max(lidar.dropoff_intensity_limit, 1e-9))
    return 1.0 - lidar.dropoff_zero_intensity * weakness


def _fired(
    lidar: Lidar, scan: Scan, air: LidarAir, draws: Draws, window: Window | None
) -> NDArray[np.bool_] | None:
    """Beams (n,) that leave the sensor and are not blinded; None if all do."""
    fired: NDArray[np.bool_] | None = None
    if lidar.dropoff_rate:
        uniform = draws.uniform(Purpose.FIRED, lidar.azimuths * lidar.channels)
        fired = uniform >= lidar.dropoff_rate
    if window is not None:
        clear = window.clear(draws.stream(Purpose.WINDOW).random(SECTORS, np.float32))
        fired = clear if fired is None else fired & clear
    if air.sun_direction is not None and lidar.sunlight_noise:
        sun = (scan.world_from_lidar[:3, :3].T @ air.sun_direction).astype(np.float32)
        aside = beams(lidar) @ sun < math.cos(SUN_BLINDS_RAD)
        fired = aside if fired is None else fired & aside
    return fired


def _parts(
    lidar: Lidar, sources: Sources, fired: NDArray[np.bool_] | None
) -> tuple[list[Echoes], list[Echoes]]:
    """Echoes of beams that were fired: of sources with one for every beam, and of the others."""
    surfaces, soft, others = sources.surfaces(), sources.air_itself(), list(sources.others())
    every = [surfaces] if soft is None else [surfaces, soft]
    if fired is not None:
        surfaces.power[:] *= np.repeat(fired, lidar.sub_rays)
        if soft is not None:
            soft.power[:] *= fired
        others = [echoes.rows(fired.take(echoes.beam)) for echoes in others]
    return (every, others) if lidar.sub_rays == 1 else ([], [*every, *others])


def _cloud(lidar: Lidar, scan: Scan, air: LidarAir, draws: Draws, found: Echoes) -> PointCloud:
    """The points of reported echoes."""
    range_m = _measured_range_m(lidar, draws, found)
    if lidar.dropoff_zero_intensity:
        uniform = draws.uniform(Purpose.DROPOFF, lidar.azimuths * lidar.channels)
        kept = np.flatnonzero(uniform.take(found.beam) < keep_share(lidar, range_m))
        found, range_m = found.rows(kept), range_m[kept]
    azimuth = found.beam // np.int32(lidar.channels)
    raw = (beams(lidar).take(found.beam, axis=0) * range_m[:, None]).astype(np.float32, copy=False)
    intensity = apparent_reflectance(found.power * np.float32(noise_of(lidar, air)), found.range_m)
    points, time_s = _compensated(lidar, scan, raw, azimuth)
    return PointCloud(
        points=points,
        raw=raw,
        intensity=np.minimum(intensity, 1.0).astype(np.float32),
        ring=(found.beam - azimuth * np.int32(lidar.channels)).astype(np.uint16),
        time_s=time_s,
        range_m=range_m.astype(np.float32, copy=False),
        semantic=found.semantic,
        instance=found.instance,
        kind=found.kind,
    )


def _measured_range_m(lidar: Lidar, draws: Draws, found: Echoes) -> Floats:
    if lidar.range_noise_model == "fixed" and not lidar.range_noise_m:
        return found.range_m
    error = draws.normal(Purpose.RANGE_NOISE, lidar.azimuths * lidar.channels)
    deviation_m = np.float32(lidar.range_noise_m)
    if lidar.range_noise_model == "signal":
        return found.range_m + error.take(found.beam) * range_deviation_m(
            found.power, lidar.range_noise_m
        )
    return found.range_m + error.take(found.beam) * deviation_m


def _compensated(
    lidar: Lidar, scan: Scan, raw: Floats, azimuth: NDArray[np.int32]
) -> tuple[Floats, Floats]:
    """Points in the frame of the frame's instant, and when each was measured."""
    if scan.now_from_then is None:
        return raw, np.zeros(len(raw), np.float32)
    motion = scan.now_from_then[azimuth]
    points = np.einsum("nij,nj->ni", motion[:, :3, :3], raw) + motion[:, :3, 3]
    time_s = (turn_shares(lidar)[azimuth] - 1.0) * TURN_S
    return points.astype(np.float32), time_s.astype(np.float32)

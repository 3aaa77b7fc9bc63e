"""Everything that sends light back to a LiDAR in one turn."""

import math
from collections.abc import Iterator
from functools import lru_cache

import numpy as np
from advercity_dsl import Lidar
from numpy.typing import NDArray

from advercity.frames import ActorState
from advercity.geometry.arrays import FloatArray, IndexArray
from advercity.rendering.raycaster import RayHits
from advercity.semantics import Semantic
from advercity.sensors.lidar.beams import sub_ray_weights
from advercity.sensors.lidar.conditions import LidarConditions, LidarWindow
from advercity.sensors.lidar.random_streams import (
    RandomStreams,
    StreamPurpose,
    draw_levels,
    normal_quantiles,
)
from advercity.sensors.lidar.received_power import (
    PULSE_LENGTH_M,
    effective_reflectance,
    received_power,
)
from advercity.sensors.lidar.returns import Returns
from advercity.sensors.lidar.scan import ScanHits
from advercity.sensors.lidar.volume_scattering import (
    LIDAR_RATIO_SR,
    LOG_POWER_DEVIATION,
    MIN_RANGE_M,
    PARTICLE_POINT_KIND,
    ParticleTable,
    PlumeCrossing,
    find_plume_crossings,
)
from advercity.sensors.measurements import PointKind

MIN_RELEVANT_POWER = 0.2
"""Power of echoes, times the sub-rays that may add up to one, that noise does not lift over the
threshold: they stand four standard deviations below."""
SPRAY_PENETRATION_M = 3.0
"""How deep into a plume echoes come from."""


class ReturnSources:
    """All that sends echoes back in one turn.

    Args:
        lidar: The sensor.
        scan: What its rays met.
        air: The weather.
        draws: Random numbers of the turn.
        window: What the sensor looks through, if it is not clean.
        states: Who may throw up spray.
    """

    def __init__(
        self,
        lidar: Lidar,
        scan: ScanHits,
        air: LidarConditions,
        draws: RandomStreams,
        *,
        window: LidarWindow | None,
        states: tuple[ActorState, ...],
    ) -> None:
        self._lidar = lidar
        self._scan = scan
        self._air = air
        self._draws = draws
        self._window = window
        self._count = lidar.azimuths * lidar.channels
        self._threshold = receiver_noise_factor(lidar, air)
        self._stop_m = scan.hits.range_m[:: lidar.sub_rays]
        self._plumes = self._find_plumes(states)
        self._spray_left = self._spray_transmittance()

    def surface_returns(self) -> Returns:
        """What rays met first: one echo a ray, in their order; of no power if there is none."""
        hits = self._scan.hits
        share = self._effective_reflectance(hits)
        share[self._scan.puddle_rays] = 0.0
        return self._hard_target_returns(
            hits, share, None, self._draw_noise(StreamPurpose.SURFACE_NOISE, len(share))
        )

    def soft_target_returns(self) -> Returns | None:
        """Fog and dust: one echo a beam, in their order; None where the air is clear.

        The droplets of each beam are a little more or fewer than the mean.
        """
        soft, lidar, count = self._air.soft_target, self._lidar, self._count
        if soft is None or lidar.soft_gain <= 0.0:
            return None
        gain = np.full(count, lidar.soft_gain / self._threshold, np.float32)
        if lidar.detection == "noisy":
            gain *= _fluctuation_table().take(
                draw_levels(self._draws.open_stream(StreamPurpose.SOFT_POWER), count)
            )
        self._apply_window_loss(gain, None)
        uniform = self._draws.uniform(StreamPurpose.SOFT_RANGE, count)
        range_m, power = soft.sample(gain, self._stop_m, uniform)
        power *= power > MIN_RELEVANT_POWER / lidar.sub_rays
        kind = np.full(count, PointKind.FOG, np.uint8)
        if soft.dust_fraction:
            dusty = self._draws.uniform(StreamPurpose.SOFT_KIND, count) < soft.dust_fraction
            kind[dusty] = PointKind.DUST
        beam = np.arange(count, dtype=np.int32)
        noise = self._draw_noise(StreamPurpose.SOFT_NOISE, count)
        return _build_airborne_returns(beam, range_m, power, noise, kind)

    def iterate_other_returns(self) -> Iterator[Returns]:
        """The echoes of everything else, source by source, each sorted by beam."""
        yield from self._secondary_returns()
        for table in self._air.particles:
            yield self._particle_returns(table)
        if self._plumes and self._lidar.soft_gain > 0.0:
            rng = self._draws.open_stream(StreamPurpose.SPRAY)
            for plume in self._plumes:
                yield self._spray_returns(plume, rng)

    def _secondary_returns(self) -> Iterator[Returns]:
        """What is behind windows or mirrored in puddles, last because weather decides on it."""
        scan = self._scan
        onward = [(one, PointKind.SURFACE) for one in scan.behind_glass]
        onward += (
            [] if scan.puddle_reflection is None else [(scan.puddle_reflection, PointKind.GHOST)]
        )
        rng = self._draws.open_stream(StreamPurpose.ONWARD_NOISE)
        for one, kind in onward:
            share = self._effective_reflectance(one.hits) * one.transmittance
            noise = self._draw_stream_noise(rng, len(one.ray))
            echoes = self._hard_target_returns(one.hits, share, one.ray, noise, kind)
            yield echoes.select(echoes.power > 0.0)

    def _particle_returns(self, table: ParticleTable) -> Returns:
        """Drops or flakes in front of whatever stops the beam."""
        kind = PARTICLE_POINT_KIND[table.sizes.kind]
        rng = self._draws.open_stream(
            StreamPurpose.RAIN if kind == PointKind.RAIN else StreamPurpose.SNOW
        )
        beam, range_m, power = table.sample(self._count, rng)
        noise = self._draw_stream_noise(rng, len(beam))
        power *= (range_m < self._stop_m[beam]) / np.float32(self._threshold)
        self._apply_window_loss(power, beam)
        return self._strong_airborne_returns(
            beam, range_m, power, noise, np.full(len(beam), kind, np.uint8)
        )

    def _spray_returns(self, plume: PlumeCrossing, rng: np.random.Generator) -> Returns:
        """One vehicle's plume, seen from its near side."""
        beam = plume.beam.astype(np.int32)
        fluctuation = _fluctuation_table().take(draw_levels(rng, len(beam)))
        noise = self._draw_stream_noise(rng, len(beam))
        deep_m = rng.random(len(beam), np.float32) * np.minimum(
            plume.through_m, SPRAY_PENETRATION_M
        )
        range_m = np.maximum(plume.enter_m + deep_m, np.float32(MIN_RANGE_M))
        depth_m = np.minimum(plume.through_m, np.float32(PULSE_LENGTH_M))
        share = plume.extinction * depth_m * np.float32(math.pi / LIDAR_RATIO_SR["spray"])
        power = received_power(range_m, share, self._air.extinction_per_m) * (
            range_m < self._stop_m[beam]
        )
        power *= fluctuation
        power *= np.float32(self._lidar.soft_gain / self._threshold)
        self._apply_window_loss(power, beam)
        kind = np.full(len(beam), PointKind.SPRAY, np.uint8)
        return self._strong_airborne_returns(beam, range_m, power, noise, kind)

    def _draw_noise(self, purpose: StreamPurpose, count: int) -> FloatArray:
        """Of the receiver when each echo arrives; none if its threshold is a step."""
        if self._lidar.detection == "step":
            return np.zeros(count, np.float32)
        return self._draws.normal(purpose, count)

    def _draw_stream_noise(self, rng: np.random.Generator, count: int) -> FloatArray:
        """The same, out of a stream that goes on."""
        drawn = draw_levels(rng, count)
        return normal_quantiles().take(drawn) * np.float32(self._lidar.detection == "noisy")

    def _effective_reflectance(self, hits: RayHits) -> FloatArray:
        air = self._air
        return effective_reflectance(
            hits,
            wetness=air.wetness,
            snow_cover=air.snow_cover,
            road_snow_cover=air.road_snow_cover,
        )

    def _hard_target_returns(
        self,
        hits: RayHits,
        share: FloatArray,
        ray: IndexArray | None,
        noise: FloatArray,
        kind: PointKind = PointKind.SURFACE,
    ) -> Returns:
        """Echoes of surfaces that rays met, one a ray; `ray` None if all rays."""
        sub_rays, count = self._lidar.sub_rays, len(share)
        rays = np.arange(count, dtype=np.int32) if ray is None else ray.astype(np.int32)
        beam = rays // np.int32(sub_rays) if sub_rays > 1 else rays
        if sub_rays > 1:
            share = share * sub_ray_weights(self._lidar)[rays % sub_rays]
        finite_m = np.minimum(hits.range_m, np.float32(self._lidar.range_m))
        power = received_power(
            finite_m, share * np.float32(1.0 / self._threshold), self._air.extinction_per_m
        )
        # A threshold below what noise can lift; what met nothing reflects nothing.
        power *= power > MIN_RELEVANT_POWER / sub_rays
        everywhere = sub_rays == 1 and ray is None
        self._apply_window_loss(power, None if everywhere else beam)
        if self._spray_left is not None:
            power *= self._spray_left if everywhere else self._spray_left.take(beam)
        return Returns(
            beam=beam,
            range_m=hits.range_m,
            power=power,
            noise=noise,
            kind=np.full(count, kind, np.uint8),
            semantic=hits.semantic,
            instance=hits.instance,
        )

    def _strong_airborne_returns(
        self,
        beam: NDArray[np.int32],
        range_m: FloatArray,
        power: FloatArray,
        noise: FloatArray,
        kind: NDArray[np.uint8],
    ) -> Returns:
        """Echoes out of the air, those too faint left out."""
        strong = power > MIN_RELEVANT_POWER / self._lidar.sub_rays
        return _build_airborne_returns(beam, range_m, power, noise, kind).select(strong)

    def _apply_window_loss(self, power: FloatArray, beam: NDArray[np.int32] | None) -> None:
        """What the window takes; `beam` None if there is one power a beam."""
        if self._window is not None:
            power *= self._window.gain if beam is None else self._window.gain[beam]

    def _find_plumes(self, states: tuple[ActorState, ...]) -> tuple[PlumeCrossing, ...]:
        if not self._air.has_spray:
            return ()
        return tuple(find_plume_crossings(self._lidar, self._scan.world_from_lidar, states))

    def _spray_transmittance(self) -> FloatArray | None:
        """Share (beams,) of the light that comes through all plumes and back."""
        if not self._plumes:
            return None
        depth = np.zeros(self._count, np.float32)
        for plume in self._plumes:
            depth[plume.beam] += plume.through_m * plume.extinction
        return np.exp(np.float32(-2.0) * depth)


def receiver_noise_factor(lidar: Lidar, air: LidarConditions) -> float:
    """Factor on the receiver's noise, and so on its threshold, by daylight."""
    return air.noise_factor if lidar.sunlight_noise else 1.0


def _build_airborne_returns(
    beam: NDArray[np.int32],
    range_m: FloatArray,
    power: FloatArray,
    noise: FloatArray,
    kind: NDArray[np.uint8],
) -> Returns:
    """Echoes that no surface sends."""
    return Returns(
        beam=beam,
        range_m=range_m,
        power=power,
        noise=noise,
        kind=kind,
        semantic=np.full(len(beam), Semantic.UNLABELED, np.uint8),
        instance=np.zeros(len(beam), np.int32),
    )


@lru_cache(maxsize=1)
def _fluctuation_table() -> NDArray[np.float32]:
    """Factor on an echo of the air by the level of a draw: log-normal."""
    return np.exp(np.float32(LOG_POWER_DEVIATION) * normal_quantiles())

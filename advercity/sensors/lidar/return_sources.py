"""Returns of one scan by source: surfaces, fog and dust, particles, spray."""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import numpy as np
from advercity_dsl import Lidar
from numpy.typing import NDArray

from advercity.frames import ActorState
from advercity.geometry.arrays import FloatArray, IndexArray
from advercity.geometry.poses import transform_points
from advercity.rendering.raycaster import RayHits
from advercity.semantics import Semantic
from advercity.sensors.lidar.beams import (
    beam_directions,
    build_scan_pattern,
    channel_efficiencies,
    sub_ray_weights,
)
from advercity.sensors.lidar.conditions import AirTables, LidarConditions, LidarWindow
from advercity.sensors.lidar.random_streams import (
    RandomStreams,
    StreamPurpose,
    draw_levels,
    normal_quantiles,
)
from advercity.sensors.lidar.received_power import Receiver, effective_reflectance
from advercity.sensors.lidar.returns import Returns
from advercity.sensors.lidar.scan import ScanHits
from advercity.sensors.lidar.stray_light import find_stray_light
from advercity.sensors.lidar.volume_scattering import (
    LOG_POWER_DEVIATION,
    MIN_RANGE_M,
    SPRAY_LIDAR_RATIO_SR,
    ParticleTable,
    PlumeCrossing,
    find_plume_crossings,
)
from advercity.sensors.measurements import PointKind
from advercity.sensors.point_kinds import find_point_kind

MIN_RELEVANT_POWER = 0.2
"""Power below which returns are dropped, divided by the sub-rays of a beam, whose powers may add
up: noise would have to lift them over the threshold by four standard deviations."""
SPRAY_PENETRATION_M = 3.0
"""Greatest depth of returns in a plume."""


@dataclass(frozen=True, eq=False)
class ReturnSources:
    """The sources of returns in one scan; the wheels of `states` may throw up spray."""

    lidar: Lidar
    scan: ScanHits
    air: LidarConditions
    streams: RandomStreams
    window: LidarWindow | None
    states: tuple[ActorState, ...]

    @cached_property
    def receiver(self) -> Receiver:
        """Sensitivity of the sensor."""
        return Receiver.from_lidar(self.lidar)

    @cached_property
    def beam_gain(self) -> FloatArray | None:
        """Factor (beams,) of window and channels on power; None without either."""
        gain = None if self.window is None else self.window.gain
        efficiency = channel_efficiencies(self.lidar)
        if efficiency is None:
            return gain
        by_beam = np.tile(efficiency, self.lidar.azimuths)
        return by_beam if gain is None else by_beam * gain

    @cached_property
    def _tables(self) -> AirTables:
        return self.air.tabulate_air(self.lidar)

    @property
    def _count(self) -> int:
        return self.lidar.azimuths * self.lidar.channels

    @property
    def _threshold(self) -> float:
        return receiver_noise_factor(self.lidar, self.air)

    @property
    def _stop_m(self) -> FloatArray:
        return self.scan.hits.range_m[:: self.lidar.sub_rays]

    def surface_returns(self) -> Returns:
        """Compute the returns of first surfaces, one per ray in order; power 0 for a miss."""
        hits = self.scan.hits
        reflectance = self._effective_reflectance(hits)
        # Water mirrors the beam away: its rays return from the mirrored surfaces instead.
        reflectance[self.scan.puddle_rays] = 0.0
        return self._hard_target_returns(
            hits, reflectance, None, self._draw_noise(StreamPurpose.SURFACE_NOISE, len(reflectance))
        )

    def soft_target_returns(self) -> Returns | None:
        """Compute the returns of floating particles, one per beam in order; None in clear air.

        The number of particles in each beam fluctuates about the mean.
        """
        soft, lidar, count = self._tables.soft_target, self.lidar, self._count
        if soft is None or lidar.soft_gain <= 0.0:
            return None
        gain = np.full(count, lidar.soft_gain / self._threshold, np.float32)
        if lidar.detection == "noisy":
            gain *= _fluctuation_table().take(
                draw_levels(self.streams.open_stream(StreamPurpose.SOFT_POWER), count)
            )
        self._apply_beam_gain(gain, None)
        uniform = self.streams.uniform(StreamPurpose.SOFT_RANGE, count)
        range_m, power = soft.sample(gain, self._stop_m, uniform)
        power *= power > MIN_RELEVANT_POWER / lidar.sub_rays
        beam = np.arange(count, dtype=np.int32)
        noise = self._draw_noise(StreamPurpose.SOFT_NOISE, count)
        kind = self._draw_soft_kinds(soft.fractions, count)
        return _build_airborne_returns(beam, range_m, power, noise, kind)

    def _draw_soft_kinds(self, fractions: Mapping[str, float], count: int) -> NDArray[np.uint8]:
        """Draw the kind (count,) of the particles in each beam's return."""
        first, *others = fractions
        kind = np.full(count, find_point_kind(first), np.uint8)
        if others:
            uniform = self.streams.uniform(StreamPurpose.SOFT_KIND, count)
            shares = [*fractions.values()]
            for number, name in enumerate(others, 1):
                kind[uniform < sum(shares[number:])] = find_point_kind(name)
        return kind

    def iterate_other_returns(self) -> Iterator[Returns]:
        """Yield the returns of all other sources, each sorted by beam."""
        # The order of sources decides ties between equally strong returns.
        yield from self._secondary_returns()
        for table in self._tables.particles:
            yield self._particle_returns(table)
        if self._plumes and self.lidar.soft_gain > 0.0:
            rng = self.streams.open_stream(StreamPurpose.SPRAY)
            for plume in self._plumes:
                yield self._spray_returns(plume, rng)

    def stray_light_returns(self, surfaces: Returns) -> Returns | None:
        """Compute the stray returns around surfaces brighter than white; None without any."""
        stray_light_db = self.lidar.receiver.stray_light_db
        if stray_light_db is None:
            return None
        seen = surfaces.select(surfaces.power > 0.0)
        white = self.receiver.received_power(seen.range_m, np.float32(1.0), 0.0)
        bright = seen.select(seen.power * np.float32(self._threshold) > white)
        if not len(bright):
            return None
        beam, range_m, power = find_stray_light(
            replace(build_scan_pattern(self.lidar, self.scan.time), sub_rays=1),
            bright,
            stray_light_db,
            self.receiver.pulse_length_m,
        )
        noise = self._draw_noise(StreamPurpose.STRAY_NOISE, self._count).take(beam)
        return _build_airborne_returns(beam, range_m, power, noise, PointKind.STRAY)

    def _secondary_returns(self) -> Iterator[Returns]:
        """Yield the returns of surfaces behind panes, then of surfaces mirrored in puddles."""
        # One stream for all: puddles, which depend on the weather, must draw last.
        scan = self.scan
        sources = [(hits, PointKind.SURFACE) for hits in scan.behind_glass]
        if scan.puddle_reflection is not None:
            sources.append((scan.puddle_reflection, PointKind.GHOST))
        rng = self.streams.open_stream(StreamPurpose.ONWARD_NOISE)
        for secondary, kind in sources:
            reflectance = self._effective_reflectance(secondary.hits) * secondary.transmittance
            noise = self._draw_stream_noise(rng, len(secondary.ray))
            returns = self._hard_target_returns(
                secondary.hits, reflectance, secondary.ray, noise, kind
            )
            yield returns.select(returns.power > 0.0)

    def _particle_returns(self, table: ParticleTable) -> Returns:
        """Compute the returns of drops or flakes in front of each beam's first surface."""
        kind = find_point_kind(table.part.name)
        purpose = StreamPurpose[kind.name] if isinstance(kind, PointKind) else kind
        rng = self.streams.open_stream(purpose)
        beam, range_m, power = table.sample(self._count, rng)
        noise = self._draw_stream_noise(rng, len(beam))
        power *= (range_m < self._stop_m[beam]) / np.float32(self._threshold)
        if self.scan.cover is not None:
            power *= ~self.scan.cover.find_covered(self._place_points(beam, range_m))
        self._apply_beam_gain(power, beam)
        return self._drop_weak(_build_airborne_returns(beam, range_m, power, noise, kind))

    def _place_points(self, beam: NDArray[np.int32], range_m: FloatArray) -> FloatArray:
        """Place points (k, 3) of beams at ranges in the world, as seen at the frame's instant."""
        own = beam_directions(self.lidar, self.scan.time)[beam] * range_m[:, None]
        return transform_points(self.scan.world_from_lidar, own)

    def _spray_returns(self, plume: PlumeCrossing, rng: np.random.Generator) -> Returns:
        """Compute the returns of one plume of spray, from its near side."""
        beam = plume.beam.astype(np.int32)
        fluctuation = _fluctuation_table().take(draw_levels(rng, len(beam)))
        noise = self._draw_stream_noise(rng, len(beam))
        penetration_m = rng.random(len(beam), np.float32) * np.minimum(
            plume.through_m, SPRAY_PENETRATION_M
        )
        range_m = np.maximum(plume.enter_m + penetration_m, np.float32(MIN_RANGE_M))
        depth_m = np.minimum(plume.through_m, np.float32(self.receiver.pulse_length_m))
        reflectance = plume.extinction_per_m * depth_m * np.float32(math.pi / SPRAY_LIDAR_RATIO_SR)
        power = self.receiver.received_power(
            range_m, reflectance, self._tables.extinction_per_m
        ) * (range_m < self._stop_m[beam])
        power *= fluctuation
        power *= np.float32(self.lidar.soft_gain / self._threshold)
        self._apply_beam_gain(power, beam)
        kind = PointKind.SPRAY
        return self._drop_weak(_build_airborne_returns(beam, range_m, power, noise, kind))

    def _draw_noise(self, purpose: StreamPurpose, count: int) -> FloatArray:
        """Draw the receiver's noise (count,) of a purpose; zeros for a sharp threshold."""
        if self.lidar.detection == "step":
            return np.zeros(count, np.float32)
        return self.streams.normal(purpose, count)

    def _draw_stream_noise(self, rng: np.random.Generator, count: int) -> FloatArray:
        """Draw the receiver's noise (count,) from an open stream, which advances in any case."""
        levels = draw_levels(rng, count)
        return normal_quantiles().take(levels) * np.float32(self.lidar.detection == "noisy")

    def _effective_reflectance(self, hits: RayHits) -> FloatArray:
        air = self.air
        return effective_reflectance(
            hits,
            wetness=air.wetness,
            snow_cover=air.snow_cover,
            road_snow_cover=air.road_snow_cover,
        )

    def _hard_target_returns(
        self,
        hits: RayHits,
        reflectance: FloatArray,
        ray: IndexArray | None,
        noise: FloatArray,
        kind: PointKind = PointKind.SURFACE,
    ) -> Returns:
        """Compute the returns of surfaces, one per ray of rows `ray` (k,); None for all rays."""
        sub_rays, count = self.lidar.sub_rays, len(reflectance)
        rays = np.arange(count, dtype=np.int32) if ray is None else ray.astype(np.int32)
        beam = rays // np.int32(sub_rays) if sub_rays > 1 else rays
        if sub_rays > 1:
            reflectance = reflectance * sub_ray_weights(self.lidar)[rays % sub_rays]
        finite_m = np.minimum(hits.range_m, np.float32(self.lidar.range_m))
        power = self.receiver.received_power(
            finite_m,
            reflectance * np.float32(1.0 / self._threshold),
            self._tables.extinction_per_m,
        )
        # Power 0 drops a return; misses have a reflectance of 0 already.
        power *= power > MIN_RELEVANT_POWER / sub_rays
        everywhere = sub_rays == 1 and ray is None
        self._apply_beam_gain(power, None if everywhere else beam)
        if self._plume_transmittance is not None:
            power *= (
                self._plume_transmittance if everywhere else self._plume_transmittance.take(beam)
            )
        return Returns(
            beam=beam,
            range_m=self._delay(hits.range_m),
            power=power,
            noise=noise,
            kind=np.full(count, kind, np.uint8),
            semantic=hits.semantic,
            instance=hits.instance,
        )

    def _drop_weak(self, returns: Returns) -> Returns:
        return returns.select(returns.power > MIN_RELEVANT_POWER / self.lidar.sub_rays)

    def _apply_beam_gain(self, power: FloatArray, beam: NDArray[np.int32] | None) -> None:
        """Multiply powers (k,) by the beams' gains in place; `beam` None for one per beam."""
        if self.beam_gain is not None:
            power *= self.beam_gain if beam is None else self.beam_gain[beam]

    def _delay(self, range_m: FloatArray) -> FloatArray:
        """Lengthen ranges (n,) by the detours of light scattered forward."""
        # A receiver without a field of view receives no such light.
        if not self._tables.delay_per_m:
            return range_m
        return range_m + np.float32(self._tables.delay_per_m) * range_m * range_m

    @cached_property
    def _plumes(self) -> tuple[PlumeCrossing, ...]:
        if not self.air.has_spray:
            return ()
        return tuple(
            find_plume_crossings(
                self.lidar,
                self.scan.world_from_lidar,
                self.states,
                time=self.scan.time,
            )
        )

    @cached_property
    def _plume_transmittance(self) -> FloatArray | None:
        """Two-way transmittance (beams,) of all plumes; None without plumes."""
        if not self._plumes:
            return None
        depth = np.zeros(self._count, np.float32)
        for plume in self._plumes:
            depth[plume.beam] += plume.through_m * plume.extinction_per_m
        return np.exp(np.float32(-2.0) * depth)


def receiver_noise_factor(lidar: Lidar, air: LidarConditions) -> float:
    """Look up the factor on the receiver's noise, and so on its threshold, by daylight."""
    return air.noise_factor if lidar.sunlight_noise else 1.0


def _build_airborne_returns(
    beam: NDArray[np.int32],
    range_m: FloatArray,
    power: FloatArray,
    noise: FloatArray,
    kind: int | NDArray[np.uint8],
) -> Returns:
    """Build returns without an object, of one kind or of a kind (k,) each."""
    return Returns(
        beam=beam,
        range_m=range_m,
        power=power,
        noise=noise,
        kind=np.full(len(beam), kind, np.uint8),
        semantic=np.full(len(beam), Semantic.UNLABELED, np.uint8),
        instance=np.zeros(len(beam), np.int32),
    )


@lru_cache(maxsize=1)
def _fluctuation_table() -> NDArray[np.float32]:
    """Tabulate the log-normal factor on a return from the air by the level of a draw."""
    return np.exp(np.float32(LOG_POWER_DEVIATION) * normal_quantiles())

"""Everything that sends light back to a LiDAR in one turn."""

import math
from collections.abc import Iterator
from functools import lru_cache
from typing import Any

import numpy as np
from advercity_dsl import Lidar
from numpy.typing import NDArray

from advercity.rendering.casting import Hits
from advercity.semantics import Semantic
from advercity.sensors.lidar.air import LidarAir
from advercity.sensors.lidar.beams import weights
from advercity.sensors.lidar.cloud import PointKind
from advercity.sensors.lidar.draws import Draws, Purpose, levels, normals
from advercity.sensors.lidar.echoes import Echoes
from advercity.sensors.lidar.particles import POINT_KIND, ParticleTable
from advercity.sensors.lidar.power import PULSE_LENGTH_M, echo
from advercity.sensors.lidar.scanning import Scan
from advercity.sensors.lidar.soft import FLUCTUATION, LIDAR_RATIO_SR, NEAREST_M
from advercity.sensors.lidar.spray import Passage, passages
from advercity.sensors.lidar.surfaces import reflected_share
from advercity.sensors.lidar.window import Window
from advercity.traffic.trace import ActorState

Floats = NDArray[np.floating[Any]]
Rows = NDArray[np.intp]

FAINTEST = 0.2
"""Power of echoes, times the sub-rays that may add up to one, that noise does not lift over the
threshold: they stand four standard deviations below."""
SPRAY_DEPTH_M = 3.0
"""How deep into a plume echoes come from."""


class Sources:
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
        scan: Scan,
        air: LidarAir,
        draws: Draws,
        *,
        window: Window | None,
        states: tuple[ActorState, ...],
    ) -> None:
        self._lidar = lidar
        self._scan = scan
        self._air = air
        self._draws = draws
        self._window = window
        self._count = lidar.azimuths * lidar.channels
        self._threshold = noise_of(lidar, air)
        self._stop_m = scan.hits.range_m[:: lidar.sub_rays]
        self._plumes = self._plumes_of(states)
        self._spray_left = self._left_by_spray()

    def surfaces(self) -> Echoes:
        """What rays met first: one echo a ray, in their order; of no power if there is none."""
        hits = self._scan.hits
        share = self._reflected(hits)
        share[self._scan.puddled] = 0.0
        return self._hard(hits, share, None, self._noise(Purpose.SURFACE_NOISE, len(share)))

    def air_itself(self) -> Echoes | None:
        """Fog and dust: one echo a beam, in their order; None where the air is clear.

        The droplets of each beam are a little more or fewer than the mean.
        """
        soft, lidar, count = self._air.soft, self._lidar, self._count
        if soft is None or lidar.soft_gain <= 0.0:
            return None
        gain = np.full(count, lidar.soft_gain / self._threshold, np.float32)
        if lidar.detection == "noisy":
            gain *= _fluctuations().take(levels(self._draws.stream(Purpose.SOFT_POWER), count))
        self._dim(gain, None)
        uniform = self._draws.uniform(Purpose.SOFT_RANGE, count)
        range_m, power = soft.draw(gain, self._stop_m, uniform)
        power *= power > FAINTEST / lidar.sub_rays
        kind = np.full(count, PointKind.FOG, np.uint8)
        if soft.dust_share:
            dusty = self._draws.uniform(Purpose.SOFT_KIND, count) < soft.dust_share
            kind[dusty] = PointKind.DUST
        beam = np.arange(count, dtype=np.int32)
        noise = self._noise(Purpose.SOFT_NOISE, count)
        return _of_air(beam, range_m, power, noise, kind)

    def others(self) -> Iterator[Echoes]:
        """The echoes of everything else, source by source, each sorted by beam."""
        yield from self._onward()
        for table in self._air.particles:
            yield self._particles(table)
        if self._plumes and self._lidar.soft_gain > 0.0:
            rng = self._draws.stream(Purpose.SPRAY)
            for plume in self._plumes:
                yield self._spray(plume, rng)

    def _onward(self) -> Iterator[Echoes]:
        """What is behind windows or mirrored in puddles, last because weather decides on it."""
        scan = self._scan
        onward = [(one, PointKind.SURFACE) for one in scan.behind]
        onward += [] if scan.mirrored is None else [(scan.mirrored, PointKind.GHOST)]
        rng = self._draws.stream(Purpose.ONWARD_NOISE)
        for one, kind in onward:
            share = self._reflected(one.hits) * one.passed
            noise = self._noise_of(rng, len(one.ray))
            echoes = self._hard(one.hits, share, one.ray, noise, kind)
            yield echoes.rows(echoes.power > 0.0)

    def _particles(self, table: ParticleTable) -> Echoes:
        """Drops or flakes in front of whatever stops the beam."""
        kind = POINT_KIND[table.sizes.kind]
        rng = self._draws.stream(Purpose.RAIN if kind == PointKind.RAIN else Purpose.SNOW)
        beam, range_m, power = table.draw(self._count, rng)
        noise = self._noise_of(rng, len(beam))
        power *= (range_m < self._stop_m[beam]) / np.float32(self._threshold)
        self._dim(power, beam)
        return self._airborne(beam, range_m, power, noise, np.full(len(beam), kind, np.uint8))

    def _spray(self, plume: Passage, rng: np.random.Generator) -> Echoes:
        """One vehicle's plume, seen from its near side."""
        beam = plume.beam.astype(np.int32)
        fluctuation = _fluctuations().take(levels(rng, len(beam)))
        noise = self._noise_of(rng, len(beam))
        deep_m = rng.random(len(beam), np.float32) * np.minimum(plume.through_m, SPRAY_DEPTH_M)
        range_m = np.maximum(plume.enter_m + deep_m, np.float32(NEAREST_M))
        depth_m = np.minimum(plume.through_m, np.float32(PULSE_LENGTH_M))
        share = plume.extinction * depth_m * np.float32(math.pi / LIDAR_RATIO_SR["spray"])
        power = echo(range_m, share, self._air.extinction) * (range_m < self._stop_m[beam])
        power *= fluctuation
        power *= np.float32(self._lidar.soft_gain / self._threshold)
        self._dim(power, beam)
        kind = np.full(len(beam), PointKind.SPRAY, np.uint8)
        return self._airborne(beam, range_m, power, noise, kind)

    def _noise(self, purpose: Purpose, count: int) -> Floats:
        """Of the receiver when each echo arrives; none if its threshold is a step."""
        if self._lidar.detection == "step":
            return np.zeros(count, np.float32)
        return self._draws.normal(purpose, count)

    def _noise_of(self, rng: np.random.Generator, count: int) -> Floats:
        """The same, out of a stream that goes on."""
        drawn = levels(rng, count)
        return normals().take(drawn) * np.float32(self._lidar.detection == "noisy")

    def _reflected(self, hits: Hits) -> Floats:
        air = self._air
        return reflected_share(
            hits, wetness=air.wetness, snow=air.snow_cover, snow_on_road=air.road_snow_cover
        )

    def _hard(
        self,
        hits: Hits,
        share: Floats,
        ray: Rows | None,
        noise: Floats,
        kind: PointKind = PointKind.SURFACE,
    ) -> Echoes:
        """Echoes of surfaces that rays met, one a ray; `ray` None if all rays."""
        sub_rays, count = self._lidar.sub_rays, len(share)
        rays = np.arange(count, dtype=np.int32) if ray is None else ray.astype(np.int32)
        beam = rays // np.int32(sub_rays) if sub_rays > 1 else rays
        if sub_rays > 1:
            share = share * weights(self._lidar)[rays % sub_rays]
        finite_m = np.minimum(hits.range_m, np.float32(self._lidar.range_m))
        power = echo(finite_m, share * np.float32(1.0 / self._threshold), self._air.extinction)
        # A threshold below what noise can lift; what met nothing reflects nothing.
        power *= power > FAINTEST / sub_rays
        everywhere = sub_rays == 1 and ray is None
        self._dim(power, None if everywhere else beam)
        if self._spray_left is not None:
            power *= self._spray_left if everywhere else self._spray_left.take(beam)
        return Echoes(
            beam=beam,
            range_m=hits.range_m,
            power=power,
            noise=noise,
            kind=np.full(count, kind, np.uint8),
            semantic=hits.semantic,
            instance=hits.instance,
        )

    def _airborne(
        self,
        beam: NDArray[np.int32],
        range_m: Floats,
        power: Floats,
        noise: Floats,
        kind: NDArray[np.uint8],
    ) -> Echoes:
        """Echoes out of the air, those too faint left out."""
        strong = power > FAINTEST / self._lidar.sub_rays
        return _of_air(beam, range_m, power, noise, kind).rows(strong)

    def _dim(self, power: Floats, beam: NDArray[np.int32] | None) -> None:
        """What the window takes; `beam` None if there is one power a beam."""
        if self._window is not None:
            power *= self._window.gain if beam is None else self._window.gain[beam]

    def _plumes_of(self, states: tuple[ActorState, ...]) -> tuple[Passage, ...]:
        if not self._air.spray:
            return ()
        return tuple(passages(self._lidar, self._scan.world_from_lidar, states))

    def _left_by_spray(self) -> Floats | None:
        """Share (beams,) of the light that comes through all plumes and back."""
        if not self._plumes:
            return None
        depth = np.zeros(self._count, np.float32)
        for plume in self._plumes:
            depth[plume.beam] += plume.through_m * plume.extinction
        return np.exp(np.float32(-2.0) * depth)


def noise_of(lidar: Lidar, air: LidarAir) -> float:
    """Factor on the receiver's noise, and so on its threshold, by daylight."""
    return air.noise if lidar.sunlight_noise else 1.0


def _of_air(
    beam: NDArray[np.int32],
    range_m: Floats,
    power: Floats,
    noise: Floats,
    kind: NDArray[np.uint8],
) -> Echoes:
    """Echoes that no surface sends."""
    return Echoes(
        beam=beam,
        range_m=range_m,
        power=power,
        noise=noise,
        kind=kind,
        semantic=np.full(len(beam), Semantic.UNLABELED, np.uint8),
        instance=np.zeros(len(beam), np.int32),
    )


@lru_cache(maxsize=1)
def _fluctuations() -> NDArray[np.float32]:
    """Factor on an echo of the air by the level of a draw: log-normal."""
    return np.exp(np.float32(FLUCTUATION) * normals())

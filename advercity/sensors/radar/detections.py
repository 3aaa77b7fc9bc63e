"""Detections of a radar: echoes above the noise around them, and false alarms.

Scattered echoes fluctuate from cell to cell, as many scatterers interfere; flashes of mirrors,
which add in phase, do not.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from advercity.geometry import poses
from advercity.geometry.arrays import Float64Array, FloatArray, IndexArray
from advercity.rendering.cover import Cover
from advercity.sensors.measurements import PointKind, RadarCube, RadarDetections
from advercity.sensors.radar import cfar
from advercity.sensors.radar.antenna import (
    build_directions,
    compute_angles,
    compute_echo_factor,
    compute_gain,
    compute_range_cell_m,
)
from advercity.sensors.radar.cells import (
    NEIGHBOUR_LEAKAGE,
    CellGrid,
    CellNumbers,
    Cells,
    NumberPurpose,
    collect_cells,
    spread_fields,
)
from advercity.sensors.radar.clutter import VELOCITY_SPREAD_M_S, FallingClutter
from advercity.sensors.radar.conditions import RadarConditions
from advercity.sensors.radar.paths import Paths
from advercity.sensors.radar.placement import PlacedRadar

ACCURACY_CELLS = 0.55
"""Standard deviation of a coordinate in cells, times the root of the signal-to-noise ratio."""
MIN_CLUTTER_SNR = 0.03
"""Least power of clutter over the noise for detections of its own."""
MIN_RANGE_M = 0.1


@dataclass(frozen=True, eq=False)
class RadarMeasurement:
    """Detections of a radar, its cells if the output is `cube`, and actors with a direct echo."""

    detections: RadarDetections
    cube: RadarCube | None
    seen_actors: frozenset[int] = frozenset()


@dataclass(frozen=True, eq=False)
class _Echoes:
    """n echoes above the threshold; `power` is over the receiver's noise, `snr` over all noise."""

    range_m: FloatArray
    rate_m_s: FloatArray
    direction: FloatArray
    power: FloatArray
    snr: FloatArray
    instance: NDArray[np.int32]
    kind: NDArray[np.uint8]

    @staticmethod
    def from_nothing(
        range_m: FloatArray,
        rate_m_s: FloatArray,
        direction: FloatArray,
        power: FloatArray,
        snr: FloatArray,
        kind: int,
    ) -> "_Echoes":
        """Build echoes without an actor."""
        no_actor = np.zeros(len(range_m), np.int32)
        kinds = np.full(len(range_m), kind, np.uint8)
        return _Echoes(range_m, rate_m_s, direction, power, snr, no_actor, kinds)

    @staticmethod
    def join(parts: "list[_Echoes]") -> "_Echoes":
        """Join echoes in order."""
        names = [item.name for item in fields(_Echoes)]
        return _Echoes(*(np.concatenate([getattr(one, name) for one in parts]) for name in names))


class Receiver:
    """Turns the paths of one radar in one frame into detections.

    Args:
        placed: The radar.
        conditions: Air, road and radome.
        interference: Noise of other radars relative to the receiver's own.
        rng: Generator of this radar and frame.
        cover: Surfaces above the ground, with no precipitation below; None if there are none.
    """

    def __init__(
        self,
        placed: PlacedRadar,
        conditions: RadarConditions,
        interference: float,
        rng: np.random.Generator,
        cover: Cover | None = None,
    ) -> None:
        radar, rotation = placed.radar, placed.world_from_radar[:3, :3]
        self._radar, self._grid = radar, CellGrid.from_radar(radar)
        self._air, self._rng, self._numbers = conditions, rng, CellNumbers(rng)
        radome_db = conditions.select_radome_db(placed.mount)
        self._clear_factor = compute_echo_factor(radar) / (1.0 + interference)
        self._factor = self._clear_factor / 10.0 ** (2.0 * radome_db / 10.0)
        self._threshold = cfar.compute_threshold(radar)
        self._world_from_radar, self._cover = placed.world_from_radar, cover
        self._clutter = [
            FallingClutter(radar, echo, (echo.velocity - placed.velocity) @ rotation)
            for echo in conditions.falling
        ]

    def measure(self, paths: Paths, free_m: Float64Array) -> RadarMeasurement:
        """Measure; `free_m` (azimuths, elevations) is the free range of each beam."""
        cells = collect_cells(self._grid, paths, self._compute_factor(paths.range_m))
        power = self._fluctuate(cells)
        falling = (self._detect_falling(item, free_m) for item in self._clutter)
        echoes = [self._detect(cells, power), *falling, self._raise_alarms()]
        cube = self._build_cube(cells, power, free_m) if self._radar.output == "cube" else None
        return RadarMeasurement(self._report(echoes), cube)

    def _compute_factor(self, range_m: FloatArray) -> FloatArray:
        """Compute the signal-to-noise ratio per strength (n,) at ranges, through the air."""
        loss_db = 2.0 * self._air.attenuation_db_km * range_m / 1e3
        return self._factor * 10.0 ** (-loss_db / 10.0)

    def _fluctuate(self, cells: Cells) -> FloatArray:
        """Compute the power (n,) of cells, with noise and leakage from their neighbours."""
        numbers, keys = self._numbers, cells.keys
        # The mean of two: Swerling's cases 3 and 4.
        looks = (NumberPurpose.FIRST_LOOK, NumberPurpose.SECOND_LOOK)
        speckle = np.mean([numbers.draw_exponential(keys, look) for look in looks], axis=0)
        echo = np.sqrt(cells.power * speckle) * numbers.draw_phasor(keys, NumberPurpose.ECHO_PHASE)
        own = np.abs(spread_fields(self._grid, cells) + echo) ** 2
        leaked = cells.look_up(np.abs(echo) ** 2, self._grid.list_neighbours(keys)).sum(axis=1)
        noise = numbers.draw_exponential(keys, NumberPurpose.NOISE) * self._compute_floor(cells)
        phase = numbers.draw_phasor(keys, NumberPurpose.NOISE_PHASE)
        return np.abs(np.sqrt(own + NEIGHBOUR_LEAKAGE * leaked) + np.sqrt(noise) * phase) ** 2

    def _compute_floor(self, cells: Cells) -> FloatArray:
        """Compute the mean (n,) of noise and precipitation in cells, over the noise."""
        floor = np.ones(len(cells.keys))
        for clutter in self._clutter:
            floor += self._compute_clutter(clutter, cells.range_m, cells.direction, cells.rate_m_s)
        return floor

    def _compute_clutter(
        self,
        clutter: FallingClutter,
        range_m: FloatArray,
        direction: FloatArray,
        rate_m_s: FloatArray,
    ) -> FloatArray:
        """Compute the mean power (n,) of precipitation in cells, over the receiver's noise."""
        strength = clutter.compute_strength(range_m, direction)
        if self._cover is not None:
            points = poses.transform_points(self._world_from_radar, direction * range_m[:, None])
            strength = strength * ~self._cover.find_covered(points)
        fraction = clutter.compute_fraction(direction, rate_m_s)
        return self._compute_factor(range_m) * strength * fraction

    def _detect(self, cells: Cells, power: FloatArray) -> _Echoes:
        """Detect the peaks above the threshold."""
        rows = np.flatnonzero(power > self._threshold)
        around = cells.look_up(power, self._grid.list_neighbours(cells.keys[rows]))
        rows = rows[power[rows] >= around.max(axis=1, initial=0.0)]
        snr = power[rows] / self._estimate_noise(cells, power, rows)
        found = np.flatnonzero(snr > self._threshold)
        rows = rows[found]
        return _Echoes(
            *(cells.range_m[rows], cells.rate_m_s[rows], cells.direction[rows]),
            *(power[rows], snr[found], cells.instance[rows], cells.kind[rows]),
        )

    def _estimate_noise(self, cells: Cells, power: FloatArray, rows: IndexArray) -> FloatArray:
        """Estimate the noise (k,) around some cells."""
        keys = cells.keys[rows, None] + cfar.list_window_steps()
        noise = self._numbers.draw_exponential(keys, NumberPurpose.WINDOW)
        floor = self._compute_floor(cells)[rows, None] * noise
        return cfar.estimate_noise(self._radar, np.maximum(cells.look_up(power, keys), floor))

    def _detect_falling(self, clutter: FallingClutter, free_m: Float64Array) -> _Echoes:
        """Detect single cells of precipitation above the level of their surroundings."""
        direction, range_m = self._grid.list_volume(free_m)
        middle = direction @ clutter.velocity
        mean = self._compute_clutter(clutter, range_m, direction, middle)
        rows = np.flatnonzero(mean > MIN_CLUTTER_SNR)
        chance = cfar.compute_clutter_chance(mean[rows], self._threshold)
        rates = VELOCITY_SPREAD_M_S * math.sqrt(2.0 * math.pi) / self._radar.speed_cell_m_s
        drawn = np.repeat(rows, self._rng.poisson(chance * rates))
        spread = self._rng.standard_normal(len(drawn)) * VELOCITY_SPREAD_M_S
        snr = self._threshold + self._rng.standard_exponential(len(drawn))
        return _Echoes.from_nothing(
            *(range_m[drawn], middle[drawn] + spread, direction[drawn]),
            *(snr * (1.0 + mean[drawn]), snr, clutter.echo.kind),
        )

    def _raise_alarms(self) -> _Echoes:
        """Detect cells of noise alone, as many as pass the threshold."""
        radar, rng = self._radar, self._rng
        chance = cfar.compute_alarm_chance(self._threshold)
        count = int(rng.poisson(chance * self._grid.size))
        azimuth, elevation = (
            np.radians((rng.random(count) - 0.5) * span)
            for span in (radar.azimuth_fov_deg, radar.elevation_fov_deg)
        )
        snr = self._threshold + rng.standard_exponential(count)
        rate_m_s = (rng.random(count) * 2.0 - 1.0) * radar.max_speed_m_s
        direction = build_directions(azimuth, elevation)
        range_m = rng.random(count) * radar.range_m
        return _Echoes.from_nothing(range_m, rate_m_s, direction, snr, snr, PointKind.NOISE)

    def _report(self, parts: list[_Echoes]) -> RadarDetections:
        """Report echoes with the errors of a receiver, the larger the weaker the echo."""
        found = _Echoes.join(parts)
        radar, deviation = self._radar, ACCURACY_CELLS / np.sqrt(np.maximum(found.power, 1.0))
        errors = self._rng.standard_normal((4, len(deviation))) * deviation
        range_m = np.maximum(found.range_m + errors[0] * compute_range_cell_m(radar), MIN_RANGE_M)
        azimuth, elevation = compute_angles(found.direction)
        azimuth = azimuth + errors[1] * math.radians(radar.azimuth_cell_deg)
        elevation = elevation + errors[2] * math.radians(radar.elevation_cell_deg)
        # Angles are found between the beams of a radar, so none is outside of them.
        half_azimuth, half_elevation = (
            math.radians(angle) / 2.0 for angle in (radar.azimuth_fov_deg, radar.elevation_fov_deg)
        )
        direction = build_directions(
            np.clip(azimuth, -half_azimuth, half_azimuth),
            np.clip(elevation, -half_elevation, half_elevation),
        )
        rate_m_s = self._grid.fold(found.rate_m_s + errors[3] * radar.speed_cell_m_s)
        per_m2 = self._clear_factor * compute_gain(radar, direction) ** 2 / range_m**4
        return RadarDetections(
            points=(range_m[:, None] * direction).astype(np.float32),
            velocity_m_s=rate_m_s.astype(np.float32),
            rcs_dbsm=(10.0 * np.log10(found.power / per_m2)).astype(np.float32),
            snr_db=(10.0 * np.log10(found.snr)).astype(np.float32),
            instance=found.instance,
            kind=found.kind,
        )

    def _build_cube(self, cells: Cells, power: FloatArray, free_m: Float64Array) -> RadarCube:
        """Build the cube of all cells, each with its strongest velocity."""
        velocities, azimuths, elevations, ranges = self._grid.counts
        shape = (azimuths, elevations, ranges)
        # The largest of `velocities` exponential numbers, drawn at once.
        strongest = -np.log1p(-(self._rng.random(shape) ** (1.0 / velocities)))
        rate = (self._rng.random(shape) * 2.0 - 1.0) * self._radar.max_speed_m_s
        for level, middle in self._iterate_falling(free_m):
            strongest *= 1.0 + level
            rate = np.where(level > 1.0, self._grid.fold(middle), rate)
        _, *place = self._grid.locate(cells.range_m, cells.rate_m_s, cells.direction)
        order = np.argsort(power, kind="stable")  # the strongest is written last
        where = tuple(number[order] for number in place)
        echo, echo_rate = np.zeros(shape), np.zeros(shape)
        echo[where], echo_rate[where] = power[order], self._grid.fold(cells.rate_m_s)[order]
        rate = np.where(echo > strongest, echo_rate, rate)
        level_db = 10.0 * np.log10(np.maximum(strongest, echo))
        by_range = (part.astype(np.float16).transpose(2, 0, 1) for part in (level_db, rate))
        return RadarCube(*map(np.ascontiguousarray, by_range))

    def _iterate_falling(self, free_m: Float64Array) -> Iterator[tuple[FloatArray, FloatArray]]:
        """Yield power and velocity in every cell for each kind of precipitation."""
        shape = self._grid.counts[1:]
        direction, range_m = self._grid.list_volume(np.full(shape[:2], np.inf))
        is_free = range_m.reshape(shape) < free_m.reshape(*shape[:2], 1)
        for clutter in self._clutter:
            middle = direction @ clutter.velocity
            mean = self._compute_clutter(clutter, range_m, direction, middle)
            yield mean.reshape(shape) * is_free, middle.reshape(shape)

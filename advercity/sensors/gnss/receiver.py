"""A satellite receiver among walls and trees: its signals, their errors, and its fix."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from functools import lru_cache

import numpy as np
from advercity_dsl.positioning import SatelliteReceiver
from numpy.typing import NDArray

from advercity.geometry.arrays import Float64Array
from advercity.geometry.geodesy import Geodetic, geodetic_from_enu
from advercity.geometry.poses import Matrix, to_yaw_pitch_roll
from advercity.randomness import create_generator, sample_gauss_markov
from advercity.sensors.gnss.constellations import compute_satellites
from advercity.sensors.gnss.signal_paths import WAVELENGTH_M, Reflections, SkyView
from advercity.sensors.gnss.solution import compute_dilution, solve_position
from advercity.sensors.measurements import GnssFix, GnssSolution, SolutionQuality

CHIP_M = 299_792_458.0 / 1.023e6
"""Length of a chip of GPS C/A and Galileo E1."""
INTEGRATION_S = 0.02
"""Integration time of the correlators."""
CARRIER_LOOP_HZ = 15.0
"""Bandwidth of the tracking of the carrier."""
FLOAT_SD_M = 0.3
"""Standard deviation of ambiguities, in metres, before they are fixed."""
SLOW_TIME_S = 300.0
"""Correlation time of the errors of orbits, clocks, the air and float ambiguities."""
EARTH_IN_AIR = 6378.1 / (6378.1 + 350.0)
"""Radius of the Earth over the radius of the middle of the ionosphere, for the slant of paths."""
MIN_CARRIERS = 5
"""Carriers for a float or fixed solution and for a heading: one more than the unknowns."""
MAX_PDOP = 25.0
"""Dilution of precision above which receivers report no position."""
LOCK_STEP_S = 0.2
"""Time between checks of the continuity of tracking."""


@dataclass(frozen=True, eq=False)
class _Sky:
    """The n satellites over an antenna at a time.

    Attributes:
        satellites: (n, 3) in the world, m.
        directions: (n, 3) from the antenna to them.
        antenna: (3,) in the world, m.
        is_above: (n,) whether they are above the mask.
        open_cn0: (n,) carrier over noise density in the open, dB-Hz.
        direct: (n,) the same along the straight path, -inf where it is blocked.
    """

    satellites: Float64Array
    directions: Float64Array
    antenna: Float64Array
    is_above: NDArray[np.bool_]
    open_cn0: Float64Array
    direct: Float64Array


@dataclass(frozen=True, eq=False)
class _Signals:
    """Signals of all n satellites at a receiver.

    Attributes:
        visible: (n,) whether the straight path is free of solid obstacles.
        tracked: (n,) whether its code is tracked.
        carrier: (n,) whether its carrier is tracked, along the straight path.
        cn0: (n,) carrier over noise density in dB-Hz.
        code_m: (n,) error of the code by reflections.
        phase_m: (n,) error of the carrier by reflections.
    """

    visible: NDArray[np.bool_]
    tracked: NDArray[np.bool_]
    carrier: NDArray[np.bool_]
    cn0: Float64Array
    code_m: Float64Array
    phase_m: Float64Array


class ReceiverInPlace:
    """A receiver on its carrier, in a world and at a date.

    Args:
        receiver: The receiver.
        sky: Obstacles and walls around it.
        origin: Geodetic position of the world frame's origin.
        pose_at: Returns the pose (4, 4) of its carrier at a time since the first frame, in s.
        key: Key of the noise, the same for all fixes.
    """

    def __init__(
        self,
        receiver: SatelliteReceiver,
        sky: SkyView,
        origin: Geodetic,
        *,
        pose_at: Callable[[float], Matrix],
        key: tuple[int | str, ...],
    ) -> None:
        self._receiver, self._sky, self._origin, self._key = receiver, sky, origin, key
        self._pose_at = pose_at
        self._start = datetime.fromisoformat(receiver.start_utc).replace(tzinfo=UTC)
        self._look_once = lru_cache(maxsize=1024)(self._look)

    def measure(
        self, time_s: float, *, velocity: Float64Array, number: int, step_s: float, stamp_s: float
    ) -> GnssFix | None:
        """Measure a fix, a function of its number and time alone.

        Args:
            time_s: Time since the first frame.
            velocity: (3,) of the carrier, m/s.
            number: Number of the fix, from 0.
            step_s: Time between fixes.
            stamp_s: Time of the fix since the scenario's start.

        Returns:
            The fix of the carrier's origin; None with too few satellites or too much dilution.
        """
        sky = self._look_once(time_s)
        signals = self._track(sky, velocity)
        solution, used = self._select(signals, time_s)
        errors = self._draw_errors(sky.directions, number, step_s)
        error_m, sd_m = errors.compute(self._receiver, signals, solution)
        ranges_m = np.linalg.norm(sky.satellites - sky.antenna, axis=1) + error_m
        found = solve_position(sky.satellites[used], ranges_m[used], sd_m[used])
        if found is None:
            return None
        dilution = compute_dilution(sky.directions[used])
        if dilution.position > MAX_PDOP:
            return None
        pose = self._pose_at(time_s)
        lever = pose[:3, :3] @ np.array(self._receiver.antenna_m)
        # Rounded to 0.1 mm, as receivers do: the last bits of a solver differ between machines.
        place = geodetic_from_enu(np.round(found - lever, 4), self._origin)
        return GnssFix(
            latitude_deg=place.latitude_deg,
            longitude_deg=place.longitude_deg,
            altitude_m=place.altitude_m,
            time_s=stamp_s,
            heading_rad=self._measure_heading(pose, sky.directions, signals, errors),
            quality=SolutionQuality(
                solution=solution,
                satellites=int(used.sum()),
                visible=int(signals.visible.sum()),
                pdop=round(dilution.position, 3),
                hdop=round(dilution.horizontal, 3),
                vdop=round(dilution.vertical, 3),
            ),
        )

    def _look(self, time_s: float) -> _Sky:
        """Find satellites and their direct signals."""
        pose, receiver = self._pose_at(time_s), self._receiver
        antenna = pose[:3, 3] + pose[:3, :3] @ np.array(receiver.antenna_m)
        time = self._start + timedelta(seconds=time_s)
        satellites = compute_satellites(receiver.constellations, time, self._origin)
        towards = satellites - antenna
        directions = towards / np.linalg.norm(towards, axis=1)[:, None]
        upwards = directions[:, 2]
        above = np.flatnonzero(upwards > math.sin(math.radians(receiver.mask_deg)))
        antennas = np.repeat(antenna[None], len(above), axis=0)
        blocked, foliage_db = self._sky.look(antennas, directions[above])
        open_cn0 = receiver.cn0_zenith_db_hz - receiver.cn0_drop_db * (1.0 - upwards)
        direct = np.full(len(directions), -np.inf)
        direct[above] = np.where(blocked, -np.inf, open_cn0[above] - foliage_db)
        is_above = np.zeros(len(directions), np.bool_)
        is_above[above] = True
        return _Sky(satellites, directions, antenna, is_above, open_cn0, direct)

    def _track(self, sky: _Sky, velocity: Float64Array) -> _Signals:
        """Track all satellites: along the straight path, or else along a reflection alone."""
        receiver, open_cn0, direct = self._receiver, sky.open_cn0, sky.direct
        reflected = self._sky.find_reflections(
            sky.antenna,
            np.where(sky.is_above[:, None], sky.directions, [0.0, 0.0, -1.0]),
            cross_polar_db=receiver.cross_polar_db,
        )
        ratio = reflected.amplitude * 10.0 ** (np.minimum(open_cn0 - direct, 200.0) / 20.0)
        is_direct = (direct >= receiver.tracking_db_hz) & (ratio < 1.0)
        mirrored = open_cn0 + 20.0 * np.log10(np.maximum(reflected.amplitude, 1e-9))
        is_mirrored = ~is_direct & (mirrored >= receiver.tracking_db_hz)
        code_m, phase_m = compute_multipath(
            np.where(is_direct, ratio, 0.0),
            reflected,
            sky.directions,
            velocity,
            correlator_chips=receiver.correlator_chips,
            loop_hz=receiver.loop_hz,
        )
        return _Signals(
            visible=sky.is_above & np.isfinite(direct),
            tracked=is_direct | is_mirrored,
            carrier=is_direct & (direct >= receiver.carrier_db_hz) & (ratio < 0.7),
            cn0=np.where(is_direct, direct, mirrored),
            code_m=np.where(is_mirrored, reflected.excess_m, code_m),
            phase_m=phase_m,
        )

    def _select(self, signals: _Signals, time_s: float) -> tuple[GnssSolution, NDArray[np.bool_]]:
        """Select the best solution for the tracked signals, and the satellites (n,) for it."""
        if self._receiver.corrections == "rtk" and signals.carrier.sum() >= MIN_CARRIERS:
            locked = signals.carrier & self._find_locked(time_s)
            if locked.sum() >= MIN_CARRIERS:
                return GnssSolution.FIXED, locked
            return GnssSolution.FLOAT, signals.carrier
        return GnssSolution.SINGLE, signals.tracked

    def _find_locked(self, time_s: float) -> NDArray[np.bool_]:
        """Find the satellites (n,) whose carriers were tracked for the time to a fix.

        Before the first frame, the vehicle is taken to have stood at its first pose.
        """
        last = math.floor(time_s / LOCK_STEP_S)
        first = last - round(self._receiver.time_to_fix_s / LOCK_STEP_S)
        steps = range(max(first, 0), max(last, 0) + 1)
        strengths = [self._look_once(round(step * LOCK_STEP_S, 6)).direct for step in steps]
        return np.min(strengths, axis=0) >= self._receiver.carrier_db_hz

    def _draw_errors(self, directions: Float64Array, number: int, step_s: float) -> "_Errors":
        count = len(directions)
        white = create_generator(*self._key, "gnss", number).standard_normal((3, count))
        (slow,) = sample_gauss_markov(
            create_generator(*self._key, "gnss signals"),
            number,
            number,
            correlation=math.exp(-step_s / SLOW_TIME_S),
            axes=3 * count + 1,
        )
        satellite, residual, ambiguity = slow[1:].reshape(3, count)
        return _Errors(white, satellite, residual, ambiguity, float(slow[0]), directions[:, 2])

    def _measure_heading(
        self, pose: Matrix, directions: Float64Array, signals: _Signals, errors: "_Errors"
    ) -> float | None:
        """Measure the heading of the line from one antenna to the other, if there are two.

        Its standard deviation is their relative position's across the line, over its length.
        """
        baseline_m, used = self._receiver.heading_baseline_m, signals.carrier
        if baseline_m == 0.0 or used.sum() < MIN_CARRIERS:
            return None
        phase_sd = np.hypot(compute_phase_noise(signals.cn0[used]), signals.phase_m[used])
        across = compute_dilution(directions[used]).horizontal / math.sqrt(2.0)
        sd = math.sqrt(2.0) * across * float(np.sqrt((phase_sd**2).mean())) / baseline_m
        yaw, _, _ = to_yaw_pitch_roll(pose)
        return (math.pi / 2.0 - yaw + sd * float(errors.white[2, 0])) % (2.0 * math.pi)


@dataclass(frozen=True, eq=False)
class _Errors:
    """Errors of the ranges to n satellites, in standard deviations.

    Attributes:
        white: (3, n) of code, carrier and heading.
        satellite: (n,) slow, of orbits and clocks.
        residual: (n,) slow, left after corrections.
        ambiguity: (n,) slow, of float ambiguities.
        air: Slow, of the delay of the air at the zenith.
        upwards: (n,) sines of the elevations.
    """

    white: Float64Array
    satellite: Float64Array
    residual: Float64Array
    ambiguity: Float64Array
    air: float
    upwards: Float64Array

    def compute(
        self, receiver: SatelliteReceiver, signals: _Signals, solution: GnssSolution
    ) -> tuple[Float64Array, Float64Array]:
        """Compute the errors (n,) of the ranges, and their assumed standard deviations (n,).

        The receiver knows strengths and elevations, not reflections.
        """
        slant = 1.0 / np.sqrt(1.0 - (EARTH_IN_AIR * np.sqrt(1.0 - self.upwards**2)) ** 2)
        if solution is GnssSolution.SINGLE:
            noise = compute_code_noise(signals.cn0, receiver)
            slow = (
                receiver.signal_error_m * self.satellite + receiver.atmosphere_m * self.air * slant
            )
            assumed = np.hypot(receiver.signal_error_m, receiver.atmosphere_m * slant)
            return slow + noise * self.white[0] + signals.code_m, np.hypot(assumed, noise)
        noise = compute_phase_noise(signals.cn0)
        remaining_m = receiver.base_km * 1e-3 * slant
        ambiguity_m = FLOAT_SD_M if solution is GnssSolution.FLOAT else 0.0
        error_m = remaining_m * self.residual + ambiguity_m * self.ambiguity
        error_m = error_m + noise * self.white[1] + signals.phase_m
        return error_m, np.hypot(np.hypot(remaining_m, ambiguity_m), noise)


def compute_code_noise(cn0_db_hz: Float64Array, receiver: SatelliteReceiver) -> Float64Array:
    """Compute the standard deviations (n,) of the code's thermal noise, metres.

    The formula is for a delay lock loop with early minus late power (Kaplan and Hegarty,
    Understanding GPS/GNSS, 3rd edition, 8.5).
    """
    cn0, spacing = 10.0 ** (cn0_db_hz / 10.0), receiver.correlator_chips
    loss = 1.0 + 2.0 / ((2.0 - spacing) * INTEGRATION_S * cn0)
    return CHIP_M * np.sqrt(receiver.loop_hz * spacing / (2.0 * cn0) * loss)


def compute_phase_noise(cn0_db_hz: Float64Array) -> Float64Array:
    """Compute the standard deviations (n,) of the carrier's thermal noise, metres (as above)."""
    cn0 = 10.0 ** (cn0_db_hz / 10.0)
    loss = 1.0 + 1.0 / (2.0 * INTEGRATION_S * cn0)
    return WAVELENGTH_M / (2.0 * np.pi) * np.sqrt(CARRIER_LOOP_HZ / cn0 * loss)


def compute_multipath(
    ratio: Float64Array,
    reflected: Reflections,
    directions: Float64Array,
    velocity: Float64Array,
    *,
    correlator_chips: float,
    loop_hz: float,
) -> tuple[Float64Array, Float64Array]:
    """Compute the errors (n,) of code and carrier, metres, by reflections next to straight paths.

    The envelope is for a delay lock loop (Braasch, in Parkinson and Spilker, Global Positioning
    System I, chapter 14, 1996). A moving antenna crosses the fringes, and loops average them (Kelly
    and Braasch, J. Navigation 48, 2001).

    Args:
        ratio: (n,) amplitude of the reflection over the straight path's, less than 1.
        reflected: The reflections.
        directions: (n, 3) to the satellites.
        velocity: (3,) of the antenna, m/s.
        correlator_chips: Spacing of the correlators.
        loop_hz: Bandwidth of the tracking of the code.
    """
    excess_m, normal = reflected.excess_m, reflected.normal
    cosine = (normal * directions).sum(axis=1)
    fringes_hz = np.abs(2.0 * cosine * (normal @ velocity)) / WAVELENGTH_M
    # A dense wall turns the phase by half a wave.
    phase = 2.0 * np.pi * (excess_m / WAVELENGTH_M % 1.0) + np.pi
    in_phase, across = ratio * np.cos(phase), ratio * np.sin(phase)
    plateau_m = correlator_chips * CHIP_M / 2.0
    fade = ((1.0 + correlator_chips / 2.0) * CHIP_M - excess_m) / (correlator_chips * CHIP_M)
    envelope_m = np.minimum(excess_m / (1.0 + in_phase), plateau_m) * np.clip(fade, 0.0, 1.0)
    code_m = in_phase * envelope_m / np.hypot(1.0, fringes_hz / loop_hz)
    carrier_rad = np.arctan2(across, 1.0 + in_phase) / np.hypot(1.0, fringes_hz / CARRIER_LOOP_HZ)
    return code_m, WAVELENGTH_M / (2.0 * np.pi) * carrier_rad

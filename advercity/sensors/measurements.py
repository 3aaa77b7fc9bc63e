"""Sensor readings: GNSS fixes, IMU samples, points, radar detections, light, optical flow.

Datasets' readers import these types, so this module depends only on NumPy.
"""

from dataclasses import dataclass
from enum import IntEnum, StrEnum
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from advercity.geometry.arrays import Float64Array

if TYPE_CHECKING:
    from advercity_dsl import RawOutput


class GnssSolution(StrEnum):
    """Method of a position's computation."""

    SINGLE = "single"
    """Code ranges alone."""
    FLOAT = "float"
    """Carrier phases with a base station, whose ambiguities are not whole numbers yet."""
    FIXED = "fixed"
    """Carrier phases with whole ambiguities."""


@dataclass(frozen=True)
class SolutionQuality:
    """Quality of a fix by satellites.

    Attributes:
        solution: Method of its computation.
        satellites: Number of satellites used.
        visible: Number of satellites above the mask with a path free of solid obstacles: truth,
            which no receiver knows.
        pdop: Dilution of precision of the position.
        hdop: Dilution of precision of the horizontal position.
        vdop: Dilution of precision of the height.
    """

    solution: GnssSolution
    satellites: int
    visible: int
    pdop: float
    hdop: float
    vdop: float


@dataclass(frozen=True)
class GnssFix:
    """A position reported by a satellite receiver."""

    latitude_deg: float
    longitude_deg: float
    altitude_m: float
    time_s: float
    """Time since the scenario's start, as `Frame.time_s`."""
    heading_rad: float | None = None
    """Heading clockwise from north, of a receiver with two antennas."""
    quality: SolutionQuality | None = None
    """Quality of the fix, for a receiver with satellites."""
    earlier: "tuple[GnssFix, ...]" = ()
    """Fixes since the previous frame, of a receiver faster than the frames."""


@dataclass(frozen=True, eq=False)
class ImuSample:
    """A sample of an inertial measurement unit.

    Attributes:
        specific_force: (3,) m/s², body frame; (0, 0, 9.81) at rest on level ground.
        angular_rate: (3,) rad/s, body frame.
        compass_rad: Heading clockwise from north, 0 to 2 pi.
        time_s: Time relative to the frame's instant, 0 or negative.
        earlier: Samples since the previous frame, for a unit faster than the frames.
    """

    specific_force: Float64Array
    angular_rate: Float64Array
    compass_rad: float
    time_s: float = 0.0
    earlier: "tuple[ImuSample, ...]" = ()


class Indicator(StrEnum):
    """State of a vehicle's indicators, whether they are lit at the moment or not."""

    OFF = "off"
    LEFT = "left"
    RIGHT = "right"
    HAZARD = "hazard"


@dataclass(frozen=True, eq=False)
class CanSample:
    """Signals of a vehicle's bus.

    Attributes:
        wheel_speeds_m_s: (4,) of front left, front right, rear left, rear right.
        speed_m_s: Speed of the vehicle, from its rear wheels.
        steering_wheel_rad: Angle of the steering wheel, positive to the left.
        yaw_rate_rad_s: Positive to the left.
        is_braking: Whether the brake's lamps are on.
        indicator: The indicators.
        time_s: Time relative to the frame's instant, 0 or negative.
        earlier: Samples since the previous frame, of a bus faster than the frames.
    """

    wheel_speeds_m_s: Float64Array
    speed_m_s: float
    steering_wheel_rad: float
    yaw_rate_rad_s: float
    is_braking: bool
    indicator: Indicator
    time_s: float = 0.0
    earlier: "tuple[CanSample, ...]" = ()


class PointKind(IntEnum):
    """Kind of a point's target; the values are written to files.

    Values from 64 on belong to weather parts of other distributions.
    """

    SURFACE = 0
    FOG = 1
    RAIN = 2
    SNOW = 3
    DUST = 4
    SPRAY = 5
    GHOST = 6
    """A surface mirrored in a puddle, reported below the ground; for radars, in any surface."""
    HAIL = 7
    NOISE = 8
    """Noise of a radar's receiver, detected as a target."""
    STRAY = 9
    """Light of a bright target in a nearby beam of a LiDAR: blooming."""


@dataclass(frozen=True, eq=False)
class PointCloud:
    """The n points of one LiDAR scan, in the order of the beams.

    Attributes:
        points: (n, 3) float32, metres, in the LiDAR frame at the frame's instant: the sensor's own
            motion during the scan is compensated.
        raw: (n, 3) float32, metres, in the LiDAR frame at each point's time; equal to `points`
            without the rig's `motion_distortion`.
        intensity: (n,) float32, 0 to 1: reflectance times cosine, attenuated by the air.
        ring: (n,) uint16 channel, from the lowest up.
        time_s: (n,) float32 relative to the frame's instant, negative; 0 in an instantaneous scan.
        range_m: (n,) float32, noise included.
        semantic: (n,) uint8 of `Semantic`; unlabelled for returns from the air.
        instance: (n,) int32 id of the actor; 0 for everything else.
        kind: (n,) uint8 of `PointKind`.
    """

    points: NDArray[np.float32]
    raw: NDArray[np.float32]
    intensity: NDArray[np.float32]
    ring: NDArray[np.uint16]
    time_s: NDArray[np.float32]
    range_m: NDArray[np.float32]
    semantic: NDArray[np.uint8]
    instance: NDArray[np.int32]
    kind: NDArray[np.uint8]


HDR_FULL_VALUE = 4095
"""Value of a full pixel of the long exposure in a linear image."""


@dataclass(frozen=True)
class CameraReadout:
    """Exposure of one image, and scale of its sensor values.

    Attributes:
        shutter_s: Exposure time.
        iso: Sensitivity.
        saturation_cd_m2: Least luminance of a grey surface for a full pixel in the long exposure.
        white_point: (3,) factors of red, green and blue of the light shown as grey.
        full_well_e: Electrons of a full pixel.
        read_noise_e: Standard deviation of the read noise in electrons.
    """

    shutter_s: float
    iso: float
    saturation_cd_m2: float
    white_point: tuple[float, float, float]
    full_well_e: float
    read_noise_e: float

    def scale_hdr(self, values: NDArray[np.uint16]) -> NDArray[np.float32]:
        """Convert a linear image (h, w, 3) to the light on the sensor in cd/m²."""
        step = np.array(self.white_point) * (self.saturation_cd_m2 / HDR_FULL_VALUE)
        return values * step.astype(np.float32)

    def count_electrons(self, values: NDArray[np.uint16], raw: "RawOutput") -> NDArray[np.float32]:
        """Convert the values (h, w) of a sensor's pixels to electrons; noise may go below 0."""
        largest_e = self.full_well_e * 2.0**raw.highlights_ev
        step = largest_e / (raw.full_value - raw.black_level)
        return (values.astype(np.float32) - raw.black_level) * np.float32(step)


@dataclass(frozen=True, eq=False)
class OpticalFlow:
    """Shifts of the points in a camera's pixels to its next image.

    Attributes:
        shift_px: (h, w, 2) float32 to the right and down; NaN for points behind the next camera
            and for actors without a next state.
        occluded: (h, w) bool, whether the next image lacks the point, as it is hidden or outside.
    """

    shift_px: NDArray[np.float32]
    occluded: NDArray[np.bool_]

    @staticmethod
    def build_unknown(shape: tuple[int, int]) -> "OpticalFlow":
        """Build the flow (h, w) of an image without a next one."""
        return OpticalFlow(np.full((*shape, 2), np.nan, np.float32), np.ones(shape, np.bool_))


KELVIN_PER_COUNT = 0.04
"""Step of a thermal image: a value times this is the kelvin of an equally bright black body."""
MAX_COUNT = 2**14 - 1
"""Largest value of a thermal image, of 14 bits."""


@dataclass(frozen=True, eq=False)
class RadarDetections:
    """The n detections of one radar at one tick.

    Attributes:
        points: (n, 3) float32, metres, in the radar's frame (x forward, y left, z up).
        velocity_m_s: (n,) float32 radial velocity, relative to the radar, positive for receding
            targets; folded into the unambiguous interval.
        rcs_dbsm: (n,) float32 radar cross-section in dB over 1 m², not corrected for weather.
        snr_db: (n,) float32 power over the estimated noise.
        instance: (n,) int32 id of the actor; 0 for everything else.
        kind: (n,) uint8 of `PointKind`.
    """

    points: NDArray[np.float32]
    velocity_m_s: NDArray[np.float32]
    rcs_dbsm: NDArray[np.float32]
    snr_db: NDArray[np.float32]
    instance: NDArray[np.int32]
    kind: NDArray[np.uint8]


@dataclass(frozen=True, eq=False)
class RadarCube:
    """Every cell of a radar at one tick, each with its strongest velocity.

    Attributes:
        power_db: (ranges, azimuths, elevations) float16 power over the receiver's noise;
            azimuths from the right to the left, elevations from the lowest up.
        velocity_m_s: (ranges, azimuths, elevations) float16 radial velocity of this power.
    """

    power_db: NDArray[np.float16]
    velocity_m_s: NDArray[np.float16]

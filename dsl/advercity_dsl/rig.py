"""Sensor rigs of connected vehicles and roadside units.

Mounts are in the body frame (x forward, y left, z up, metres, origin on the ground below the
centre of the vehicle). A positive pitch looks down, a positive yaw left.
"""

import math
from typing import Annotated, Literal, NamedTuple, Self

from pydantic import Field, model_validator

from advercity_dsl.base import (
    ByName,
    CompactModel,
    Declaration,
    InvalidCombination,
    Items,
    Model,
    is_empty,
    is_none,
)
from advercity_dsl.can_bus import CanBus
from advercity_dsl.inertial import Imu
from advercity_dsl.lens import MAX_RENDERED_PX, CameraLens, find_edge_angle
from advercity_dsl.lidar import Lidar
from advercity_dsl.mount import Mount
from advercity_dsl.positioning import SatelliteReceiver
from advercity_dsl.sampling import Sampled
from advercity_dsl.thermal import ThermalCamera
from advercity_dsl.units import (
    Count,
    DecibelMilliwatts,
    Decibels,
    Degrees,
    Flag,
    Fraction,
    Megahertz,
    Metres,
    MetresPerSecond,
    Milliradians,
    Milliseconds,
    Number,
    PositiveMetres,
    RangeReason,
    Seconds,
)


class Exposure(CompactModel):
    """Exposure of a camera."""

    mode: Literal["auto", "sensor", "manual"] = "auto"
    """`auto` meters every image with a fixed shutter: a grey filter darkens days, gain brightens
    nights. `sensor` meters without a filter: it adjusts the shutter from 20 µs to 1/30 s, or to
    `shutter_s` if that is longer, and then ISO up to 10,000. `manual` uses shutter and ISO as
    given."""
    f_number: Annotated[Number, Field(ge=0.5, le=64)] = 1.4
    """F-number of the aperture."""
    shutter_s: Annotated[Seconds, Field(ge=1e-6, le=1)] = 0.005
    """Exposure time."""
    iso: Annotated[Number, Field(ge=1, le=10_000_000)] = 100
    """Sensitivity."""
    compensation_ev: Annotated[Number, Field(ge=-8, le=8)] = 0
    """Exposure compensation in stops, positive for brighter images; 0 is the meter of ISO 2720."""


Spread = Annotated[Milliradians, Field(ge=0, le=20)]
MAX_SPREAD_PX = 30.0
"""Largest standard deviation of a point's image, which takes time by its size."""


class PointSpread(CompactModel):
    """Blur by a lens: the image of a point is a Gaussian, wider away from the middle.

    The figures are standard deviations on the sensor over the focal length: a pixel of 3 um behind
    6 mm is 0.5 mrad. The variance that a corner has more than the middle grows with the fourth
    power of the distance from the middle, as curvature of field and astigmatism of third order
    blur.
    """

    centre_mrad: Spread = 0
    """In the middle of the image."""
    corner_mrad: Spread = 0
    """In its corners."""

    @model_validator(mode="after")
    def _check_growth(self) -> Self:
        if self.corner_mrad < self.centre_mrad:
            message = "is less than `centre_mrad`"
            hint = "give at least that, for a blur that is even over the image"
            raise InvalidCombination(("corner_mrad",), message, hint)
        return self


class Dirt(CompactModel):
    """Spots of dirt on the glass of a camera, which stay through all frames and weathers."""

    coverage: Annotated[Fraction, Field(ge=0, le=0.9)] = 0.02
    """Fraction of the glass that they cover."""
    seed: Count = 0
    """Seed of their places; each carrier and mount has its own for every seed."""


class RawOutput(CompactModel):
    """Values of the sensor's pixels, each behind a filter of one colour."""

    pattern: Literal["rggb", "bggr", "grbg", "gbrg"] = "rggb"
    """Filters of the first two pixels of the first row, and of the second."""
    bits: Annotated[Count, Field(ge=8, le=16)] = 12
    """Bits of the converter; its largest value is a full pixel."""
    black_level: Annotated[Count, Field(ge=0, le=4096)] = 64
    """Value without light and noise."""
    highlights_ev: Annotated[Number, Field(ge=0, le=4)] = Field(default=0, exclude_if=is_empty)
    """Stops above a full pixel that the largest value is: with those of the camera, values are of
    all its exposures, linear in light; 0 is the long exposure alone."""

    @model_validator(mode="after")
    def _check_black_level(self) -> Self:
        if self.black_level > self.full_value // 2:
            message = f"is more than half of the largest value of {self.bits} bits"
            hint = f"give at most {self.full_value // 2}, or more bits"
            raise InvalidCombination(("black_level",), message, hint)
        return self

    @property
    def full_value(self) -> int:
        """Largest value: that of a full pixel, or of its highlights."""
        return 2**self.bits - 1


class Isp(CompactModel):
    """Image signal processor: makes the image of the values of the sensor's pixels.

    It reads those that `raw` describes; of a camera without, 16 bits with all highlights, whose
    black level is 1024.
    """

    demosaic: Literal["bilinear", "edge_aware"] = "edge_aware"
    """How colours between the filters are found: as means of all neighbours, or green as that of
    the two between which it changes less."""
    denoise: Annotated[Fraction, Field(ge=0, le=0.95)] = 0.5
    """Fraction of the noise that is removed from even surfaces; 0 leaves all."""
    sharpening: Annotated[Fraction, Field(ge=0, le=1)] = 0.25
    """Overshoot of a sharp edge over its height."""
    jpeg_quality: Annotated[Count, Field(ge=1, le=100)] | None = Field(
        default=None, exclude_if=is_none
    )
    """Quality of the JPEG that the image was compressed to, whose artefacts it has; without it, it
    is not compressed."""


MAX_BLURRED_S = 0.1
"""Longest exposure that is blurred: a tick, in which bodies go on as their derivatives say."""


class Shutter(CompactModel):
    """Rows that are exposed one after the other, from the top, and blur by motion meanwhile.

    The frame's instant is the middle of the readout and of the exposure: then the middle row is in
    the middle of its exposure. The scene is rendered once for each band of rows, as it is when the
    middle of the band is exposed; what moves by p pixels in the readout is p / (2 bands) pixels off
    at most. With blur, it is rendered several times over the exposure of each band.
    """

    readout_ms: Annotated[Milliseconds, Field(ge=0, le=100)] = 0
    """Time from the exposure of the first row to that of the last; 0 exposes all at once."""
    bands: Annotated[Count, Field(ge=1, le=128)] = 8
    """Bands of rows; each takes the time of an image."""
    blur_samples: Annotated[Count, Field(ge=1, le=33)] = 1
    """Instants of the exposure of which an image is the mean, an odd number: labels are those of
    the middle one. 1 is no blur; each takes the time of an image."""
    led_flicker: Flag = False
    """Whether signals and tail lamps flicker, as LEDs do on rectified mains and on pulses; without
    it, the sensor mitigates it."""

    @model_validator(mode="after")
    def _check_bands(self) -> Self:
        if "bands" in self.model_fields_set and self.bands > 1 and self.readout_ms == 0:
            message = "has no effect without readout_ms"
            raise InvalidCombination(("bands",), message, "give the readout time of the sensor")
        return self

    @model_validator(mode="after")
    def _check_blur_samples(self) -> Self:
        if self.blur_samples % 2 == 0:
            hint = f"give {self.blur_samples - 1} or {self.blur_samples + 1}"
            raise InvalidCombination(("blur_samples",), "is even", hint)
        return self


TruthImage = Literal["instance", "normal", "flow"]
"""An image of truth that a camera may have."""


class Camera(Sampled):
    """A camera; the semantic camera has the same pose, size, field of view and lens.

    Without a rate it takes an image with every frame.
    """

    width_px: Annotated[Count, Field(ge=16, le=8192)] = 1920
    """Image width."""
    height_px: Annotated[Count, Field(ge=16, le=8192)] = 1080
    """Image height."""
    horizontal_fov_deg: Annotated[Degrees, Field(gt=5, lt=170)] = 100
    """Angle that the width of the image spans, with its lens."""
    lens: CameraLens | None = Field(default=None, exclude_if=is_none)
    """Distortion by the lens; without it, the camera is a pinhole."""
    exposure: Exposure = Exposure()
    """How it is exposed."""
    highlights_ev: Annotated[Number, Field(ge=0, le=4)] = 4
    """Stops above pixel saturation that the sensor resolves and the tone curve compresses; 0 is a
    plain sensor, which clips."""
    combined_exposures: Annotated[Count, Field(ge=1, le=4)] = Field(
        default=1, exclude_if=lambda value: value == 1
    )
    """Exposures at once, as of split pixels, that share these stops evenly: each value has the
    noise and the steps of the longest that it does not fill. 1 is a well as deep as all stops."""
    noise: Flag = True
    """Whether shot noise and read noise are simulated."""
    vignetting: Annotated[Number, Field(ge=0, le=8)] = 1
    """Exponent of the cosine by which images darken off axis: 4 for a simple lens, 0 for none."""
    flare: Annotated[Number, Field(ge=0, le=10)] = 1
    """Brightness of lens ghosts relative to a coated lens; 0 is none."""
    point_spread: PointSpread | None = Field(default=None, exclude_if=is_none)
    """Blur by the lens; without it, images are sharp to the pixel."""
    dirt: Dirt | None = Field(default=None, exclude_if=is_none)
    """Dirt that stays on the glass, besides what the weather leaves there; without it, none."""
    shutter: Shutter | None = Field(default=None, exclude_if=is_none)
    """Rolling shutter and blur by motion; without it, images show one instant."""
    hdr: Flag = Field(default=False, exclude_if=is_empty)
    """Whether a linear image of 16 bits is written too: what the sensor measured before the tone
    curve, with the stops of `highlights_ev`."""
    raw: RawOutput | None = Field(default=None, exclude_if=is_none)
    """The image of the sensor's pixels behind their colour filters, which is written too; without
    it, none is."""
    isp: Isp | None = Field(default=None, exclude_if=is_none)
    """How the image is made of these pixels; without it, each pixel of the image senses all three
    colours."""
    truth: Annotated[Items[TruthImage], Field(max_length=3)] = Field(
        default=(), exclude_if=is_empty
    )
    """Images of truth besides classes and depths: `instance` has the id of the actor that each
    pixel shows, `normal` the direction of its surface, `flow` where its point is in the next image,
    and whether that shows it."""
    mounts: Annotated[Items[Mount], Field(min_length=1, max_length=8)]
    """Pose of each camera of this kind."""

    @model_validator(mode="after")
    def _check_lens(self) -> Self:
        if self.lens is None:
            return self
        try:
            reach = math.tan(self.edge_angle_rad)
        except ValueError as error:
            hint = "check its coefficients, or give a smaller horizontal_fov_deg"
            raise InvalidCombination(("lens",), str(error), hint) from error
        rendered_px = round(2 * reach * self.focal_px)
        if rendered_px > MAX_RENDERED_PX:
            message = f"needs {rendered_px} pixels across to render, more than {MAX_RENDERED_PX}"
            hint = "give a smaller width_px or horizontal_fov_deg"
            raise InvalidCombination(("lens",), message, hint)
        return self

    @model_validator(mode="after")
    def _check_point_spread(self) -> Self:
        if self.point_spread is None:
            return self
        limit_mrad = 1000 * MAX_SPREAD_PX / self.focal_px
        if self.point_spread.corner_mrad > limit_mrad:
            place = "point_spread", "corner_mrad"
            message = f"is more than {MAX_SPREAD_PX:g} pixels of this camera"
            raise InvalidCombination(place, message, f"give at most {limit_mrad:.2g}")
        return self

    @model_validator(mode="after")
    def _check_combined_exposures(self) -> Self:
        if self.combined_exposures > 1 and self.highlights_ev == 0:
            message, hint = (
                "has no effect without highlights_ev",
                "give the stops that they resolve",
            )
            raise InvalidCombination(("combined_exposures",), message, hint)
        return self

    @model_validator(mode="after")
    def _check_raw_highlights(self) -> Self:
        if self.raw is not None and self.raw.highlights_ev > self.highlights_ev:
            message = f"is more than the sensor resolves, {self.highlights_ev:g}"
            hint = f"give at most {self.highlights_ev:g}, or the camera more `highlights_ev`"
            raise InvalidCombination(("raw", "highlights_ev"), message, hint)
        return self

    @model_validator(mode="after")
    def _check_flow(self) -> Self:
        if "flow" in self.truth and self.is_rolling:
            message = "cannot be measured between images of a rolling shutter"
            hint = "leave out `flow`, or `readout_ms` of the shutter"
            raise InvalidCombination(("truth",), message, hint, other_path=("shutter",))
        return self

    @model_validator(mode="after")
    def _check_flow_rate(self) -> Self:
        if "flow" in self.truth and self.rate_hz is not None:
            message = "cannot be measured for a camera with a rate of its own"
            hint = "leave out `flow`, or `rate_hz`"
            raise InvalidCombination(("truth",), message, hint, other_path=("rate_hz",))
        return self

    @model_validator(mode="after")
    def _check_readout_time(self) -> Self:
        if self.shutter is None or self.rate_hz is None:
            return self
        period_ms = 1000 / self.rate_hz
        if self.shutter.readout_ms > period_ms:
            message = f"is longer than from image to image, {period_ms:g} ms"
            hint = f"give at most that, or a lower rate_hz than {self.rate_hz:g}"
            place = ("shutter", "readout_ms")
            raise InvalidCombination(place, message, hint, other_path=("rate_hz",))
        return self

    @model_validator(mode="after")
    def _check_blurred_time(self) -> Self:
        has_blur = self.shutter is not None and self.shutter.blur_samples > 1
        if has_blur and self.exposure.shutter_s > MAX_BLURRED_S:
            message = f"is longer than {MAX_BLURRED_S:g} s, for which motion is known to blur"
            hint = "give less, or no blur_samples"
            raise InvalidCombination(("exposure", "shutter_s"), message, hint)
        return self

    @property
    def sensor_values(self) -> RawOutput:
        """What the values of the sensor's pixels are that `raw` writes and `isp` reads."""
        of_isp = {"bits": 16, "black_level": 1024, "highlights_ev": self.highlights_ev}
        return self.raw or RawOutput.model_validate(of_isp)

    @property
    def is_rolling(self) -> bool:
        """Whether its rows are exposed one after the other."""
        return self.shutter is not None and self.shutter.readout_ms > 0

    @property
    def renders(self) -> int:
        """Images that a renderer makes for one of this camera."""
        if self.shutter is None:
            return 1
        bands = self.shutter.bands if self.is_rolling else 1
        return bands * self.shutter.blur_samples + self.is_metered_first

    @property
    def has_moments(self) -> bool:
        """Whether its images show other moments than the frame's instant without flicker."""
        has_flicker = self.shutter is not None and self.shutter.led_flicker
        return self.renders > 1 or has_flicker or self.rate_hz is not None

    @property
    def is_metered_first(self) -> bool:
        """Whether an image is rendered to meter the exposure that decides blur and flicker."""
        shutter, is_self_exposing = self.shutter or Shutter(), self.exposure.mode == "sensor"
        return is_self_exposing and (shutter.blur_samples > 1 or shutter.led_flicker)

    @property
    def focal_px(self) -> float:
        """Focal length in pixels of an image of `width_px`."""
        half_rad = math.radians(self.horizontal_fov_deg / 2)
        reach = math.tan(half_rad) if self.lens is None else self.lens.compute_radius(half_rad)
        return self.width_px / (2 * reach)

    @property
    def more_images(self) -> tuple[str, ...]:
        """Kinds of images that are written besides those of every camera."""
        asked = {"hdr": self.hdr, "raw": self.raw is not None}
        return (*self.truth, *(kind for kind, is_asked in asked.items() if is_asked))

    @property
    def edge_angle_rad(self) -> float:
        """Angle off the axis within which all rays of the image are."""
        half_rad = math.radians(self.horizontal_fov_deg / 2)
        corner_ratio = math.hypot(1, self.height_px / self.width_px)
        if self.lens is None:
            return math.atan(corner_ratio * math.tan(half_rad))
        return find_edge_angle(self.lens, half_rad, corner_ratio)


class Radar(Sampled):
    """A 4-D imaging radar at 77 GHz: range, radial velocity, azimuth and elevation.

    Cells are those that it resolves. Without a rate it measures with every frame.
    """

    bandwidth_mhz: Annotated[Megahertz, Field(ge=50, le=4000)] = 375
    """Swept bandwidth; 375 MHz is a range cell of 0.4 m."""
    range_m: Annotated[PositiveMetres, Field(ge=5, le=500)] = 150
    """Maximum range."""
    max_speed_m_s: Annotated[MetresPerSecond, Field(ge=5, le=150)] = 30
    """Largest radial velocity that is unambiguous; what is faster folds into this interval."""
    speed_cell_m_s: Annotated[MetresPerSecond, Field(ge=0.02, le=5)] = 0.15
    """Cell of the radial velocity."""
    azimuth_fov_deg: Annotated[Degrees, Field(ge=1, le=170)] = 120
    """Horizontal field of view."""
    azimuth_cell_deg: Annotated[Degrees, Field(ge=0.1, le=30)] = 1.5
    """Horizontal cell."""
    elevation_fov_deg: Annotated[Degrees, Field(ge=1, le=120)] = 30
    """Vertical field of view."""
    elevation_cell_deg: Annotated[Degrees, Field(ge=0.1, le=30)] = 2
    """Vertical cell."""
    rays: Annotated[Count, Field(ge=100, le=1_000_000)] = 60_000
    """Rays that sample the field of view."""
    bounces: Annotated[Count, Field(ge=1, le=3)] = 3
    """Surfaces that a ray may hit, one after the other."""
    transmit_dbm: Annotated[DecibelMilliwatts, Field(ge=-20, le=40)] = 12
    """Transmitted power."""
    noise_figure_db: Annotated[Decibels, Field(ge=0, le=40)] = 12
    """Noise figure of the receiver."""
    detector: Literal["ca", "os"] = "ca"
    """How the noise around a cell is estimated: cell-averaging or ordered-statistic CFAR."""
    threshold_db: Annotated[Decibels, Field(ge=3, le=40)] = 13
    """Power over the estimated noise that is a detection."""
    duty_cycle: Annotated[Fraction, Field(ge=0.01)] = 0.5
    """Fraction of the time in which it transmits, and so disturbs other radars."""
    output: Literal["points", "cube"] = "points"
    """Whether the powers of all cells are written too."""
    mounts: Annotated[Items[Mount], Field(min_length=1, max_length=8)]
    """Pose of each radar of this kind."""


class Gnss(Sampled):
    """Satellite positioning: with noise alone, or by satellites among walls and trees.

    `carla` uses the noise in degrees and `altitude_noise_m`; `realistic` white noise plus a
    first-order Gauss-Markov error, both in metres and larger vertically; `satellites` ranges to
    satellites as `receiver` says.
    """

    mode: Literal["carla", "realistic", "satellites"] = "carla"
    """Error model: that of CARLA, of a real receiver in the open, or one of the place."""
    receiver: SatelliteReceiver = SatelliteReceiver()
    """The receiver, for `satellites`."""
    latitude_noise_deg: Annotated[
        Degrees, Field(ge=0, le=0.01), RangeReason("0.01 deg are a kilometre")
    ] = 0
    """Standard deviation of the latitude, for `carla`."""
    longitude_noise_deg: Annotated[
        Degrees, Field(ge=0, le=0.01), RangeReason("0.01 deg are a kilometre")
    ] = 0
    """Standard deviation of the longitude, for `carla`."""
    altitude_noise_m: Annotated[
        Metres, Field(ge=0, le=1000), RangeReason("no receiver errs by a kilometre")
    ] = 0
    """Standard deviation of the altitude, for `carla`."""
    white_noise_m: Annotated[Metres, Field(ge=0, le=100)] = 0.3
    """Standard deviation of the white noise, for `realistic`."""
    wander_m: Annotated[Metres, Field(ge=0, le=100)] = 1.0
    """Standard deviation of the Gauss-Markov error, for `realistic`."""
    wander_time_s: Annotated[Seconds, Field(ge=1, le=3600)] = 120
    """Correlation time of the Gauss-Markov error, for `realistic`."""
    vertical_factor: Annotated[Number, Field(ge=0, le=10)] = 1.75
    """Factor of vertical errors over horizontal ones, for `realistic`."""

    @model_validator(mode="after")
    def _check_receiver(self) -> Self:
        if self.mode != "satellites" and self.receiver != SatelliteReceiver():
            message = f"has no effect with mode {self.mode}"
            raise InvalidCombination(("receiver",), message, "write mode: satellites")
        return self


class MountedCamera(NamedTuple):
    """One camera of a carrier; `name` is that of its kind, empty for those of `camera`."""

    camera: Camera
    mount: Mount
    name: str


class MountedRadar(NamedTuple):
    """One radar of a carrier."""

    radar: Radar
    mount: Mount


class MountedThermal(NamedTuple):
    """One thermal camera of a carrier."""

    camera: ThermalCamera
    mount: Mount


class SensorSet(Model):
    """The sensors of one kind of agent."""

    camera: Camera
    """Cameras of one kind, and the semantic cameras at the same poses."""
    more_cameras: Annotated[ByName[Camera], Field(max_length=8)] = Field(
        default_factory=dict, exclude_if=is_empty
    )
    """Cameras of other kinds, each with its own size, field of view and exposure, by name. They are
    numbered after those of `camera`, in the order in which they are written."""
    lidar: Lidar
    """The LiDAR."""
    more_lidars: Annotated[ByName[Lidar], Field(max_length=8)] = Field(
        default_factory=dict, exclude_if=is_empty
    )
    """Other LiDARs, by name, numbered from 1 in the order in which they are written."""
    radar: Radar | None = Field(default=None, exclude_if=is_none)
    """Radars of one kind; `null` is none."""
    thermal: ThermalCamera | None = Field(default=None, exclude_if=is_none)
    """Thermal cameras of one kind; `null` is none."""
    gnss: Gnss = Gnss()
    """Satellite positioning."""
    imu: Imu | None = None
    """Accelerometer and gyroscope; `null` is none."""
    can: CanBus | None = Field(default=None, exclude_if=is_none)
    """Signals of the vehicle's own bus; `null` is none."""

    @property
    def cameras(self) -> tuple[MountedCamera, ...]:
        """All cameras, by their numbers in a dataset."""
        kinds = {"": self.camera, **self.more_cameras}
        return tuple(
            MountedCamera(camera, mount, name)
            for name, camera in kinds.items()
            for mount in camera.mounts
        )

    @property
    def lidars(self) -> tuple[Lidar, ...]:
        """All LiDARs, by their numbers in a dataset; the first is `lidar`."""
        return (self.lidar, *self.more_lidars.values())

    @property
    def radars(self) -> tuple[MountedRadar, ...]:
        """All radars, by their numbers in a dataset."""
        radar = self.radar
        return () if radar is None else tuple(MountedRadar(radar, item) for item in radar.mounts)

    @property
    def thermals(self) -> tuple[MountedThermal, ...]:
        """All thermal cameras, by their numbers in a dataset."""
        kind = self.thermal
        return () if kind is None else tuple(MountedThermal(kind, item) for item in kind.mounts)

    @property
    def has_rates(self) -> bool:
        """Whether a sensor has images, scans or detections at a rate of its own."""
        cameras = [self.camera, *self.more_cameras.values()]
        kinds = [*cameras, *self.lidars, self.radar, self.thermal]
        return any(kind is not None and kind.rate_hz is not None for kind in kinds)


class Rig(Declaration):
    """The sensors of every agent of a scenario."""

    kind: Literal["rig"] = "rig"
    vehicle: SensorSet | None = None
    """Sensors of a connected vehicle; without them, the rig is for roadside units only."""
    roadside_unit: SensorSet | None = None
    """Sensors of a roadside unit, whose position the road gives; without them, the rig is for
    vehicles only."""

    @model_validator(mode="after")
    def _check_sensors(self) -> Self:
        if self.vehicle is None and self.roadside_unit is None:
            hint = "give sensors of a `vehicle`, of a `roadside_unit`, or of both"
            raise InvalidCombination((), "has no sensors", hint)
        if self.roadside_unit is not None and self.roadside_unit.can is not None:
            where = ("roadside_unit", "can")
            raise InvalidCombination(where, "a roadside unit has no wheels", "leave `can` out")
        return self

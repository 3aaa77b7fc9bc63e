"""A sensor rig: what connected vehicles and roadside units carry, and where.

Mounts are in the body frame (x forward, y left, z up, metres, origin on the ground under the
middle of the vehicle). A positive pitch looks down, a positive yaw left.
"""

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from advercity_dsl.base import CompactModel, Declaration, Model
from advercity_dsl.units import (
    Count,
    Degrees,
    Flag,
    Fraction,
    Metres,
    Number,
    PositiveMetres,
    Seconds,
)


class Mount(CompactModel):
    """Where a sensor sits on its carrier."""

    x_m: Metres = 0
    """Forward of the origin."""
    y_m: Metres = 0
    """Left of the origin."""
    z_m: Metres = 0
    """Above the ground."""
    yaw_deg: Degrees = 0
    """Positive turns left."""
    pitch_deg: Degrees = 0
    """Positive looks down."""
    roll_deg: Degrees = 0
    """Positive lowers the right side."""


class Exposure(CompactModel):
    """How a camera gathers light."""

    mode: Literal["auto", "sensor", "manual"] = "auto"
    """`auto` meters every picture and leaves the shutter as it is: a grey filter dims days, gain
    lightens nights. `sensor` meters too, but has no filter: it moves the shutter, from 20 µs to
    1/60 s or `shutter_s` if that is longer, and only then ISO, up to 10,000. `manual` takes shutter
    and ISO as they are."""
    f_number: Annotated[Number, Field(gt=0)] = 1.4
    """Of the aperture."""
    shutter_s: Annotated[Seconds, Field(gt=0, le=1)] = 0.005
    """How long the shutter is open."""
    iso: Annotated[Number, Field(gt=0)] = 100
    """Sensitivity."""
    compensation_ev: Annotated[Number, Field(ge=-8, le=8)] = 0.79
    """Brighter by so many stops than the meter says."""


class Camera(CompactModel):
    """A pinhole camera; its semantic twin shares the pose, size and field of view."""

    width_px: Annotated[Count, Field(ge=16, le=8192)] = 1920
    """Columns of pixels."""
    height_px: Annotated[Count, Field(ge=16, le=8192)] = 1080
    """Rows of pixels."""
    horizontal_fov_deg: Annotated[Degrees, Field(gt=5, lt=170)] = 100
    """Angle of view from the left border to the right."""
    exposure: Exposure = Exposure()
    """How it gathers light."""
    highlights_ev: Annotated[Number, Field(ge=0, le=4)] = 4
    """Stops beyond a full pixel that the sensor tells apart and the tone curve rolls off; 0 is a
    plain sensor, which clips."""
    noise: Flag = True
    """Whether photons and electronics make noise."""
    vignetting: Annotated[Number, Field(ge=0, le=8)] = 1
    """Power of the cosine by which pictures darken off the axis: 4 a plain lens, 0 not at all."""
    flare: Annotated[Number, Field(ge=0, le=10)] = 1
    """Brightness of ghosts of sun and lamps against those of a coated lens; 0 is none."""
    mounts: Annotated[tuple[Mount, ...], Field(min_length=1, max_length=8)]
    """One per camera of this kind."""


class Lidar(CompactModel):
    """A spinning LiDAR of ten turns a second that starts each turn straight ahead, to the left.

    The defaults are the original's: an ideal instrument that sees one instant, but through the
    weather.
    """

    mount: Mount = Mount()
    """Where it sits."""
    channel_table: Literal["uniform", "hdl_32e", "vlp_32c"] = "uniform"
    """Elevations of the channels: evenly from `lower_deg` to `upper_deg`, or of a real sensor."""
    channels: Annotated[Count, Field(ge=1, le=256)] = 32
    """Beams above each other."""
    lower_deg: Degrees = -25
    """Elevation of the lowest beam."""
    upper_deg: Degrees = 15
    """Elevation of the highest beam."""
    azimuths: Annotated[Count, Field(ge=16, le=36_000)] = 3750
    """Beams of a channel in one turn."""
    range_m: Annotated[PositiveMetres, Field(le=1000)] = 200
    """Beyond this it does not listen."""
    sub_rays: Literal[1, 7] = 1
    """Rays that stand for one beam; 7 let a beam meet two surfaces at an edge."""
    motion_distortion: Flag = False
    """Whether the turn takes the time from tick to tick, while everything moves on."""
    echoes: Literal["strongest", "last", "dual"] = "strongest"
    """Which echoes of a beam are reported; dual is both."""
    detection: Literal["noisy", "step"] = "noisy"
    """Whether the receiver's noise helps or hinders an echo at the threshold."""
    range_noise_m: Annotated[Metres, Field(ge=0, le=1)] = 0
    """Standard deviation of a distance."""
    range_noise_model: Literal["fixed", "signal"] = "fixed"
    """`signal` adds what a weak echo costs: 0.75 m over its signal-to-noise ratio."""
    soft_gain: Annotated[Number, Field(ge=0, le=100)] = 1
    """Factor on echoes of fog, dust and spray; below 1 for receivers that suppress them."""
    sunlight_noise: Flag = True
    """Whether daylight raises the threshold and the sun blinds beams that look into it."""
    dropoff_rate: Fraction = 0
    """Share of rays that are never fired."""
    dropoff_intensity_limit: Fraction = 1
    """Echoes weaker than this may be lost."""
    dropoff_zero_intensity: Fraction = 0
    """Chance that an echo of no strength is lost; less for stronger ones."""

    @model_validator(mode="after")
    def _check_channel_count(self) -> Self:
        if self.channel_table != "uniform" and self.channels != 32:
            raise ValueError(f"{self.channel_table} has 32 channels, not {self.channels}")
        return self

    @model_validator(mode="after")
    def _check_elevation_range(self) -> Self:
        if self.upper_deg <= self.lower_deg:
            raise ValueError(
                f"upper_deg {self.upper_deg:g} is not above lower_deg {self.lower_deg:g}"
            )
        return self


class Gnss(CompactModel):
    """Satellite positioning: the original's white noise in degrees, or a real receiver's errors.

    `carla` uses the noise in degrees and `altitude_noise_m`; `realistic` the rest: white noise on
    top of an error that wanders (first-order Gauss-Markov), both in metres, larger upwards.
    """

    mode: Literal["carla", "realistic"] = "carla"
    """Whose errors: the original's, or a real receiver's."""
    latitude_noise_deg: Annotated[Degrees, Field(ge=0)] = 0
    """Standard deviation northwards, for `carla`."""
    longitude_noise_deg: Annotated[Degrees, Field(ge=0)] = 0
    """Standard deviation eastwards, for `carla`."""
    altitude_noise_m: Annotated[Metres, Field(ge=0)] = 0
    """Standard deviation upwards, for `carla`."""
    white_noise_m: Annotated[Metres, Field(ge=0, le=100)] = 0.3
    """Standard deviation from fix to fix, for `realistic`."""
    wander_m: Annotated[Metres, Field(ge=0, le=100)] = 1.0
    """Standard deviation of the error that wanders, for `realistic`."""
    wander_time_s: Annotated[Seconds, Field(ge=1, le=3600)] = 120
    """In this time the wandering error forgets itself, for `realistic`."""
    vertical_factor: Annotated[Number, Field(ge=0, le=10)] = 1.75
    """Upwards errors are so many times larger, for `realistic`."""


class Imu(CompactModel):
    """Accelerometer, gyroscope and compass at the vehicle's origin."""

    grade: Literal["ideal", "low", "mid", "high"] = "ideal"
    """How good it is; `ideal` has no errors."""
    compass_noise_deg: Annotated[Degrees, Field(ge=0, le=90)] = 0
    """Standard deviation of the heading."""
    samples_per_tick: Annotated[Count, Field(ge=1, le=100)] = 1
    """1 is ten samples a second, 10 a hundred."""


class SensorSet(Model):
    """The sensors of one kind of agent."""

    camera: Camera
    """Cameras of one kind, and their semantic twins."""
    lidar: Lidar
    """The LiDAR."""
    gnss: Gnss = Gnss()
    """Satellite positioning."""
    imu: Imu | None = None
    """Accelerometer and gyroscope; `null` is none."""


class Rig(Declaration):
    """The sensors of every agent of a scenario."""

    kind: Literal["rig"] = "rig"
    vehicle: SensorSet
    """What each connected vehicle carries."""
    roadside_unit: SensorSet
    """What each roadside unit carries; the road says where it stands."""

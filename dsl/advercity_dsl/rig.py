"""A sensor rig: what connected vehicles and roadside units carry, and where.

Mounts are in the body frame (x forward, y left, z up, metres, origin on the ground under the
middle of the vehicle). A positive pitch looks down, a positive yaw left.
"""

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from advercity_dsl.base import Declaration, Degrees, Metres, Model, PositiveMetres, Seconds, Share


class Mount(Model):
    """Where a sensor sits on its carrier."""

    x_m: Metres = 0
    y_m: Metres = 0
    z_m: Metres = 0
    yaw_deg: Degrees = 0
    pitch_deg: Degrees = 0
    roll_deg: Degrees = 0


class Exposure(Model):
    """How a camera gathers light."""

    mode: Literal["auto", "manual"] = "auto"
    f_number: Annotated[float, Field(gt=0)] = 1.4
    shutter_s: Annotated[Seconds, Field(gt=0, le=1)] = 0.005
    iso: Annotated[float, Field(gt=0)] = 100
    compensation_ev: Annotated[float, Field(ge=-8, le=8)] = 0.79


class Camera(Model):
    """A pinhole camera; its semantic twin shares the pose, size and field of view."""

    width_px: Annotated[int, Field(ge=16, le=8192)] = 1920
    height_px: Annotated[int, Field(ge=16, le=8192)] = 1080
    horizontal_fov_deg: Annotated[Degrees, Field(gt=5, lt=170)] = 100
    exposure: Exposure = Exposure()
    noise: bool = True
    mounts: Annotated[tuple[Mount, ...], Field(min_length=1, max_length=8)]


class Lidar(Model):
    """A spinning LiDAR of ten turns a second that starts each turn straight ahead, to the left.

    The defaults are the original's: an ideal instrument that sees one instant, but through the
    weather.
    """

    mount: Mount = Mount()
    channel_table: Literal["uniform", "hdl_32e", "vlp_32c"] = "uniform"
    """Elevations of the channels: evenly from `lower_deg` to `upper_deg`, or of a real sensor."""
    channels: Annotated[int, Field(ge=1, le=256)] = 32
    lower_deg: Degrees = -25
    upper_deg: Degrees = 15
    azimuths: Annotated[int, Field(ge=16, le=36_000)] = 3750
    range_m: Annotated[PositiveMetres, Field(le=1000)] = 200
    sub_rays: Literal[1, 7] = 1
    """Rays that stand for one beam; 7 let a beam meet two surfaces at an edge."""
    motion_distortion: bool = False
    """Whether the turn takes the time from tick to tick, while everything moves on."""
    echoes: Literal["strongest", "last", "dual"] = "strongest"
    """Which echoes of a beam are reported; dual is both."""
    detection: Literal["noisy", "step"] = "noisy"
    """Whether the receiver's noise helps or hinders an echo at the threshold."""
    range_noise_m: Annotated[Metres, Field(ge=0, le=1)] = 0
    range_noise_model: Literal["fixed", "signal"] = "fixed"
    """`signal` adds what a weak echo costs: 0.75 m over its signal-to-noise ratio."""
    soft_gain: Annotated[float, Field(ge=0, le=100)] = 1
    """Factor on echoes of fog, dust and spray; below 1 for receivers that suppress them."""
    sunlight_noise: bool = True
    """Whether daylight raises the threshold and the sun blinds beams that look into it."""
    dropoff_rate: Share = 0
    """Share of rays that are never fired."""
    dropoff_intensity_limit: Share = 1
    dropoff_zero_intensity: Share = 0

    @model_validator(mode="after")
    def _channels_fit(self) -> Self:
        if self.channel_table != "uniform" and self.channels != 32:
            raise ValueError(f"{self.channel_table} has 32 channels, not {self.channels}")
        return self

    @model_validator(mode="after")
    def _opens_upwards(self) -> Self:
        if self.upper_deg <= self.lower_deg:
            raise ValueError(
                f"upper_deg {self.upper_deg:g} is not above lower_deg {self.lower_deg:g}"
            )
        return self


class Gnss(Model):
    """Satellite positioning: the original's white noise in degrees, or a real receiver's errors.

    `carla` uses the noise in degrees and `altitude_noise_m`; `realistic` the rest: white noise on
    top of an error that wanders (first-order Gauss-Markov), both in metres, larger upwards.
    """

    mode: Literal["carla", "realistic"] = "carla"
    latitude_noise_deg: Annotated[Degrees, Field(ge=0)] = 0
    longitude_noise_deg: Annotated[Degrees, Field(ge=0)] = 0
    altitude_noise_m: Annotated[Metres, Field(ge=0)] = 0
    white_noise_m: Annotated[Metres, Field(ge=0, le=100)] = 0.3
    wander_m: Annotated[Metres, Field(ge=0, le=100)] = 1.0
    wander_time_s: Annotated[Seconds, Field(ge=1, le=3600)] = 120
    vertical_factor: Annotated[float, Field(ge=0, le=10)] = 1.75


class Imu(Model):
    """Accelerometer, gyroscope and compass at the vehicle's origin."""

    grade: Literal["ideal", "low", "mid", "high"] = "ideal"
    compass_noise_deg: Annotated[Degrees, Field(ge=0, le=90)] = 0
    samples_per_tick: Annotated[int, Field(ge=1, le=100)] = 1
    """1 is ten samples a second, 10 a hundred."""


class Carrier(Model):
    """The sensors of one kind of agent."""

    camera: Camera
    lidar: Lidar
    gnss: Gnss = Gnss()
    imu: Imu | None = None


class Rig(Declaration):
    """The sensors of every agent of a scenario."""

    kind: Literal["rig"] = "rig"
    vehicle: Carrier
    roadside_unit: Carrier

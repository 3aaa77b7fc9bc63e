"""A sensor rig: what connected vehicles and roadside units carry, and where.

Mounts are in the body frame (x forward, y left, z up, metres, origin on the ground under the
middle of the vehicle). A positive pitch looks down, a positive yaw left.
"""

from typing import Annotated, Literal

from pydantic import Field

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
    """A spinning LiDAR with channels at uniform elevations."""

    mount: Mount = Mount()
    channels: Annotated[int, Field(ge=1, le=256)] = 32
    lower_deg: Degrees = -25
    upper_deg: Degrees = 15
    azimuths: Annotated[int, Field(ge=16, le=36_000)] = 3750
    range_m: Annotated[PositiveMetres, Field(le=1000)] = 200
    range_noise_m: Annotated[Metres, Field(ge=0, le=1)] = 0
    dropoff_rate: Share = 0
    """Share of rays that are never fired."""
    dropoff_intensity_limit: Share = 1
    dropoff_zero_intensity: Share = 0


class Gnss(Model):
    """Satellite positioning with white noise in degrees and metres, as the original has it."""

    latitude_noise_deg: Annotated[Degrees, Field(ge=0)] = 0
    longitude_noise_deg: Annotated[Degrees, Field(ge=0)] = 0
    altitude_noise_m: Annotated[Metres, Field(ge=0)] = 0


class Imu(Model):
    """Accelerometer, gyroscope and compass at the vehicle's origin."""

    grade: Literal["ideal", "low", "mid", "high"] = "ideal"


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

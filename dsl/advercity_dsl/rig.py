"""Sensor rigs of connected vehicles and roadside units.

Mounts are in the body frame (x forward, y left, z up, metres, origin on the ground below the
centre of the vehicle). A positive pitch looks down, a positive yaw left.
"""

from typing import Annotated, Literal, NamedTuple, Self

from pydantic import Field, model_validator

from advercity_dsl.base import (
    ByName,
    Declaration,
    InvalidCombination,
    Items,
    Model,
    is_empty,
    is_none,
)
from advercity_dsl.camera import Camera
from advercity_dsl.can_bus import CanBus
from advercity_dsl.inertial import Imu
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
    Fraction,
    Megahertz,
    Metres,
    MetresPerSecond,
    Number,
    PositiveMetres,
    RangeReason,
    Seconds,
)


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

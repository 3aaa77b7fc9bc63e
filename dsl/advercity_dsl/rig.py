"""Sensor rigs of connected vehicles and roadside units.

Mounts are in the body frame (x forward, y left, z up, metres, origin on the ground below the
centre of the vehicle). A positive pitch looks down, a positive yaw left.
"""

from typing import TYPE_CHECKING, Annotated, Any, Generic, Literal, NamedTuple, Self, TypeVar

from pydantic import Field, model_validator

from advercity_dsl.base import (
    ByName,
    Declaration,
    InvalidCombination,
    Model,
    is_empty,
    is_none,
)
from advercity_dsl.camera import Camera
from advercity_dsl.can_bus import CanBus
from advercity_dsl.inertial import Imu
from advercity_dsl.lidar import Lidar
from advercity_dsl.mount import Mount
from advercity_dsl.positioning import Gnss
from advercity_dsl.radar import Radar
from advercity_dsl.registry import add_fields
from advercity_dsl.sampling import Sampled
from advercity_dsl.sensor_kinds import load_sensor_kinds
from advercity_dsl.thermal import ThermalCamera

_ORIGIN = Mount()
_Sensor = TypeVar("_Sensor", bound=Sampled)


class MountedSensor(NamedTuple, Generic[_Sensor]):
    """One sensor of a carrier; `name` is the one under `more_...`, empty for all others."""

    model: _Sensor
    mount: Mount
    name: str


class SensorSet(Model):
    """The sensors of one kind of agent."""

    camera: Camera | None = Field(default=None, exclude_if=is_none)
    """Cameras of one kind, and the semantic cameras at the same poses; `null` is none."""
    more_cameras: Annotated[ByName[Camera], Field(max_length=8)] = Field(
        default_factory=dict, exclude_if=is_empty
    )
    """Cameras of other kinds, each with its own size, field of view and exposure, by name. They are
    numbered after the cameras of `camera`, in written order."""
    lidar: Lidar | None = Field(default=None, exclude_if=is_none)
    """The LiDAR; `null` is none."""
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

    def list_sensors(self, kind: str) -> tuple[MountedSensor[Any], ...]:
        """List the sensors of a kind, by their numbers in a dataset; empty if it has none."""
        models = {"": getattr(self, kind), **getattr(self, f"more_{kind}s", {})}
        return tuple(
            MountedSensor(model, mount, name)
            for name, model in models.items()
            if model is not None
            for mount in getattr(model, "mounts", (getattr(model, "mount", _ORIGIN),))
        )

    @property
    def cameras(self) -> tuple[MountedSensor[Camera], ...]:
        """All cameras, by their numbers in a dataset."""
        return self.list_sensors("camera")

    @property
    def lidars(self) -> tuple[Lidar, ...]:
        """All LiDARs, by their numbers in a dataset."""
        return tuple(item.model for item in self.list_sensors("lidar"))

    @property
    def radars(self) -> tuple[MountedSensor[Radar], ...]:
        """All radars, by their numbers in a dataset."""
        return self.list_sensors("radar")

    @property
    def thermals(self) -> tuple[MountedSensor[ThermalCamera], ...]:
        """All thermal cameras, by their numbers in a dataset."""
        return self.list_sensors("thermal")

    @property
    def has_rates(self) -> bool:
        """Whether a sensor has images, scans or detections at a rate of its own."""
        return any(
            sensor.model.rate_hz is not None
            for kind in load_sensor_kinds().found.values()
            if kind.has_place
            for sensor in self.list_sensors(kind.name)
        )


if not TYPE_CHECKING:
    # Fields of kinds from other distributions.
    SensorSet = add_fields(
        SensorSet,
        {
            kind.name: (kind.model | None, Field(None, exclude_if=is_none, description=kind.title))
            for kind in load_sensor_kinds().found.values()
            if kind.name not in SensorSet.model_fields
        },
    )


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
        for kind in load_sensor_kinds().found.values():
            unit = self.roadside_unit
            if kind.not_on_units and unit is not None and unit.list_sensors(kind.name):
                where, hint = ("roadside_unit", kind.name), f"leave `{kind.name}` out"
                raise InvalidCombination(where, kind.not_on_units, hint)
        return self

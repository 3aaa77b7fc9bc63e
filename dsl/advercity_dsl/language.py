"""The names of the declaration language, which `advercity_dsl` gives out."""

from advercity_dsl.base import Declaration, Id, Model
from advercity_dsl.camera import Camera, Dirt, Exposure, Isp, PointSpread, RawOutput, Shutter
from advercity_dsl.catalogue import (
    Blueprint,
    BodyModel,
    Catalogue,
    LampPositions,
    PedestrianAppearance,
)
from advercity_dsl.channel import Channel
from advercity_dsl.conflict import Conflict, OutcomeCriteria, StagedActor, StagedConflict
from advercity_dsl.inertial import Imu
from advercity_dsl.lidar import Lidar, LidarModel
from advercity_dsl.mount import Mount
from advercity_dsl.positioning import Gnss
from advercity_dsl.radar import Radar
from advercity_dsl.rig import MountedSensor, Rig, SensorSet
from advercity_dsl.road import (
    MapFile,
    MapNetwork,
    Road,
    RoadsideUnit,
    Street,
    TrajectoryFile,
    TrajectorySet,
    Vehicle,
)
from advercity_dsl.spec import SPEC_VERSION, Agent, Spec, Unrecorded
from advercity_dsl.suite import Suite, Timing
from advercity_dsl.thermal import ThermalCamera
from advercity_dsl.traffic import (
    ActorClass,
    Density,
    DriverResponse,
    Drivers,
    TimedDriverResponse,
)
from advercity_dsl.typology import Typology
from advercity_dsl.weather import Weather

DECLARATIONS: dict[str, type[Declaration]] = {
    "typology": Typology,
    "conflict": Conflict,
    "road": Road,
    "weather": Weather,
    "density": Density,
    "drivers": Drivers,
    "rig": Rig,
    "lidar_model": LidarModel,
    "channel": Channel,
    "catalogue": Catalogue,
    "suite": Suite,
}
"""Model class of each kind of declaration."""
LANGUAGE_VERSION = 1
"""Version of the declaration language; raised by changes incompatible with existing files."""


def get_declaration_kind(declaration: Declaration) -> str:
    """Return the `kind` under which a declaration is written."""
    return next(kind for kind, model in DECLARATIONS.items() if isinstance(declaration, model))


__all__ = [
    "DECLARATIONS",
    "LANGUAGE_VERSION",
    "SPEC_VERSION",
    "ActorClass",
    "Agent",
    "Blueprint",
    "BodyModel",
    "Camera",
    "Catalogue",
    "Channel",
    "Conflict",
    "Declaration",
    "Density",
    "Dirt",
    "DriverResponse",
    "Drivers",
    "Exposure",
    "Gnss",
    "Id",
    "Imu",
    "Isp",
    "LampPositions",
    "Lidar",
    "LidarModel",
    "MapFile",
    "MapNetwork",
    "Model",
    "Mount",
    "MountedSensor",
    "OutcomeCriteria",
    "PedestrianAppearance",
    "PointSpread",
    "Radar",
    "RawOutput",
    "Rig",
    "Road",
    "RoadsideUnit",
    "SensorSet",
    "Shutter",
    "Spec",
    "StagedActor",
    "StagedConflict",
    "Street",
    "Suite",
    "ThermalCamera",
    "TimedDriverResponse",
    "Timing",
    "TrajectoryFile",
    "TrajectorySet",
    "Typology",
    "Unrecorded",
    "Vehicle",
    "Weather",
    "get_declaration_kind",
]

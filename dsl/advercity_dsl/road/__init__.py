"""Roads: streets with lanes, junctions, signals, surroundings, and positions of agents.

Positions are in the world frame (x east, y north, z up, metres). Headings are in degrees,
counter-clockwise from east. Traffic drives on the right.
"""

from advercity_dsl.road.arms import ArmUnit, ArmVehicle, JunctionAgents
from advercity_dsl.road.declaration import (
    BackgroundDemand,
    ClassFractions,
    EgoRoute,
    Road,
    RoadsideUnit,
    Vehicle,
)
from advercity_dsl.road.junctions import (
    Crossing,
    Junction,
    LaneText,
    Movement,
    MovementText,
    Sign,
    SignalHead,
    Signals,
)
from advercity_dsl.road.streets import (
    AxisArc,
    AxisHeight,
    AxisLine,
    AxisPoints,
    CrossSection,
    MapFile,
    MapNetwork,
    RoadMark,
    Street,
    Strip,
    StripKind,
)
from advercity_dsl.road.surroundings import (
    BuildingUse,
    FurnitureDensity,
    RoadsidePlacement,
    Roof,
    Season,
    SignKind,
    Species,
    Surrounding,
    SurroundingKind,
)
from advercity_dsl.road.trajectories import TrackId, TrajectoryFile, TrajectorySet

__all__ = [
    "ArmUnit",
    "ArmVehicle",
    "AxisArc",
    "AxisHeight",
    "AxisLine",
    "AxisPoints",
    "BackgroundDemand",
    "BuildingUse",
    "ClassFractions",
    "CrossSection",
    "Crossing",
    "EgoRoute",
    "FurnitureDensity",
    "Junction",
    "JunctionAgents",
    "LaneText",
    "MapFile",
    "MapNetwork",
    "Movement",
    "MovementText",
    "Road",
    "RoadMark",
    "RoadsidePlacement",
    "RoadsideUnit",
    "Roof",
    "Season",
    "Sign",
    "SignKind",
    "SignalHead",
    "Signals",
    "Species",
    "Street",
    "Strip",
    "StripKind",
    "Surrounding",
    "SurroundingKind",
    "TrackId",
    "TrajectoryFile",
    "TrajectorySet",
    "Vehicle",
]

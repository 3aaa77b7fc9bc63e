"""A road: streets with lanes, junctions, signals, surroundings, and where agents stand.

Positions are in the world frame (x east, y north, z up, metres). Headings are in degrees,
counter-clockwise from east. Traffic drives on the right.
"""

from advercity_dsl.road.agents import EgoRoute, RoadsideUnit, Vehicle
from advercity_dsl.road.declaration import Road
from advercity_dsl.road.demand import ClassShares, Demand
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
from advercity_dsl.road.maps import MapFile, MapNetwork
from advercity_dsl.road.sections import CrossSection, Paint, Strip, StripKind
from advercity_dsl.road.streets import Arc, Height, Line, Polyline, Street
from advercity_dsl.road.surroundings import Beside, Species, Surrounding, SurroundingKind

__all__ = [
    "Arc",
    "Beside",
    "ClassShares",
    "CrossSection",
    "Crossing",
    "Demand",
    "EgoRoute",
    "Height",
    "Junction",
    "LaneText",
    "Line",
    "MapFile",
    "MapNetwork",
    "Movement",
    "MovementText",
    "Paint",
    "Polyline",
    "Road",
    "RoadsideUnit",
    "Sign",
    "SignalHead",
    "Signals",
    "Species",
    "Street",
    "Strip",
    "StripKind",
    "Surrounding",
    "SurroundingKind",
    "Vehicle",
]

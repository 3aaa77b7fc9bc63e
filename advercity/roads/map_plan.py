"""Maps as netconvert takes them: in metres, with traffic on the right."""

from dataclasses import dataclass
from typing import Literal
from xml.etree.ElementTree import Element

from advercity_dsl.road import MapPlace
from advercity_dsl.units import Point2

Side = Literal["left", "right"]


@dataclass(frozen=True, eq=False)
class MapPlan:
    """A map in the plan frame: east and north, or east and south if traffic is on the left.

    Attributes:
        root: The document.
        driving_side: Side on which traffic drives in the world.
        origin_m: The map's own coordinates, east and north, of the plan's origin.
        place: Where the plan's origin is on the globe, if the map says it.
        crossings: Places of the pedestrian crossings that the document does not tell netconvert of.
    """

    root: Element
    driving_side: Side = "right"
    origin_m: Point2 = (0.0, 0.0)
    place: MapPlace | None = None
    crossings: tuple[tuple[float, float], ...] = ()

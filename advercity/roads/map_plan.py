"""Plans of maps: all that an import needs of a format, in metres, with traffic on the right."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal
from xml.etree.ElementTree import Element, SubElement

import numpy as np
from advercity_dsl import MapFile
from advercity_dsl.road import MapPlace
from advercity_dsl.units import Point2

from advercity.geometry.polyline import Points
from advercity.roads.map_conversion import Conversion
from advercity.roads.sumo_xml import BORDER_ATTRIBUTES, format_shape

Side = Literal["left", "right"]


@dataclass(frozen=True, eq=False)
class LaneLines:
    """Middle (n, 3) of a lane, and its borders where SUMO's line and width do not give them."""

    centre: Points
    borders: tuple[Points, ...]


@dataclass(frozen=True, eq=False)
class MapPlan:
    """A map in the plan frame: east and north, or east and south if traffic is on the left.

    Attributes:
        conversion: Documents and options for netconvert.
        driving_side: Side on which traffic drives in the world.
        origin_m: The map's own coordinates, east and north, of the plan's origin.
        place: Where the plan's origin is on the globe, if the map says it.
        confirm: Builds the second conversion, which leaves only the marked crossings in the network
            of the first; None where it may keep all.
        names: Names of streets by edge; None if netconvert copies them.
        lanes: Lines of lanes by SUMO's id, where netconvert would simplify them.
        outlines: Kind and ring (n, 3) of paving inside junctions.
    """

    conversion: Conversion
    driving_side: Side = "right"
    origin_m: Point2 = (0.0, 0.0)
    place: MapPlace | None = None
    confirm: Callable[[Element], Conversion | None] | None = None
    names: Mapping[str, str] | None = None
    lanes: Mapping[str, LaneLines] = field(default_factory=dict[str, LaneLines])
    outlines: Sequence[tuple[str, Points]] = ()

    def complete(self, net: Element) -> None:
        """Add to a converted network, in place, the lines and outlines that netconvert cannot."""
        for lane in net.iter("lane"):
            lines = self.lanes.get(lane.attrib["id"])
            if lines is not None:
                # netconvert drops points that are close to each other, and borders have all.
                lane.set("shape", format_shape(lines.centre))
                for name, border in zip(BORDER_ATTRIBUTES, lines.borders, strict=False):
                    lane.set(name, format_shape(border))
        for number, (kind, ring) in enumerate(self.outlines):
            shape = format_shape(ring)
            SubElement(net, "poly", {"id": f"{kind}_{number}", "type": kind, "shape": shape})


def place_extent(
    declared: MapFile, origin_m: Point2, side: Side
) -> tuple[float, float, float, float] | None:
    """Place the declared part of a map in the plan frame: least x and y, largest x and y."""
    if declared.extent_m is None:
        return None
    corners = (np.array(declared.extent_m) - origin_m) * (1, -1 if side == "left" else 1)
    west, south, east, north = (*corners.min(axis=0).tolist(), *corners.max(axis=0).tolist())
    return west, south, east, north


def build_extent_options(
    declared: MapFile, origin_m: Point2 = (0.0, 0.0), side: Side = "right"
) -> dict[str, str]:
    """Build netconvert's option for the declared part of a map; none for a whole map."""
    box = place_extent(declared, origin_m, side)
    if box is None:
        return {}
    return {"keep-edges.in-boundary": ",".join(f"{value:.3f}" for value in box)}

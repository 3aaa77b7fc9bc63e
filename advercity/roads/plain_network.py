"""Networks in SUMO's plain XML, which importers of lane maps write and netconvert compiles."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from xml.etree.ElementTree import Element

from advercity_dsl import Road
from advercity_dsl.road import MapPlace, RoadMark
from advercity_dsl.units import Point2

from advercity.errors import InputError
from advercity.geometry.polyline import Points
from advercity.roads.imported_crossings import declare_marked, get_guess_options
from advercity.roads.map_conversion import JUNCTION_OPTIONS, Conversion
from advercity.roads.map_plan import LaneLines, LaneLink, MapPlan, Side

PLAIN_OPTIONS = {
    "node-files": "nodes.xml",
    "edge-files": "edges.xml",
    "connection-files": "connections.xml",
    **JUNCTION_OPTIONS,
}


@dataclass(frozen=True, eq=False)
class PlainNetwork:
    """A lane map as plain XML, and the parts of it that plain XML cannot hold.

    Attributes:
        nodes: Document of nodes.
        edges: Document of edges.
        connections: Document of connections.
        names: Names of streets in the map, by edge.
        lanes: Lines of every lane, by SUMO's id.
        paths: Lines of ways through junctions.
        outlines: Kind and ring (n, 3) of paving inside junctions.
        crosswalks: Middles of the crosswalks of the map.
        stripes: Mark and line (n, 3) of all painted lines; none if the map has none.
    """

    nodes: Element
    edges: Element
    connections: Element
    names: dict[str, str]
    lanes: dict[str, LaneLines]
    paths: dict[LaneLink, LaneLines]
    outlines: list[tuple[str, Points]]
    crosswalks: list[tuple[float, float]]
    stripes: Sequence[tuple[RoadMark, Points]] = ()

    def plan(self, road: Road, side: Side, origin_m: Point2, place: MapPlace | None) -> MapPlan:
        """Build the plan of a map from this network in the plan frame.

        Raises:
            InputError: It has no street.
        """
        if not self.names:
            raise InputError("has no lane for cars")
        conversion = Conversion(
            {
                "nodes.xml": self.nodes,
                "edges.xml": self.edges,
                "connections.xml": self.connections,
            },
            PLAIN_OPTIONS | get_guess_options(road, self.crosswalks),
        )
        return MapPlan(
            conversion=conversion,
            driving_side=side,
            origin_m=origin_m,
            place=place,
            crossings=self.crosswalks,
            confirm=partial(declare_marked, plain=conversion),
            names=self.names,
            lanes=self.lanes,
            paths=self.paths,
            outlines=self.outlines,
            stripes=self.stripes,
        )

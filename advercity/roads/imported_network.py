"""An imported SUMO network by the use of its edges."""

from dataclasses import dataclass, replace
from functools import cached_property

import shapely

from advercity.roads.network_file import (
    LaneConnection,
    PaintedStripe,
    PavedOutline,
    SumoEdge,
    SumoJunction,
    SumoNetwork,
)

MAX_BORDER_GAP_M = 0.8
"""Between the left borders of opposite directions on one line; a median is wider."""


@dataclass(frozen=True, eq=False)
class ImportedNetwork:
    """Edges, junctions and connections with an extent in the world.

    Attributes:
        edges: Edges between junctions by id.
        internal_edges: Edges inside junctions for vehicles.
        crossings: Edges on which pedestrians cross.
        governed_crossings: Crossings with lights, by the id of the signal.
        walking_areas: Edges on which pedestrians walk from sidewalk to crossing.
        junctions: Junctions by id.
        lane_links: Connections from street to street.
        outlines: Paving inside junctions, as the map has it.
        stripes: Painted lines, if the map has them.
    """

    edges: dict[str, SumoEdge]
    internal_edges: tuple[SumoEdge, ...]
    crossings: tuple[SumoEdge, ...]
    governed_crossings: dict[str, SumoEdge]
    walking_areas: tuple[SumoEdge, ...]
    junctions: dict[str, SumoJunction]
    lane_links: tuple[LaneConnection, ...]
    outlines: tuple[PavedOutline, ...]
    stripes: tuple[PaintedStripe, ...]

    @classmethod
    def from_network(cls, network: SumoNetwork) -> "ImportedNetwork":
        """Sort the parts of a network, without lanes of a single point."""
        solid = [_drop_point_lanes(edge) for edge in network.edges]
        groups: dict[str, list[SumoEdge]] = {}
        for edge in solid:
            if edge.lanes:
                groups.setdefault(edge.function, []).append(edge)
        streets = {edge.id: edge for edge in groups.get("normal", ())}
        return cls(
            edges=streets,
            internal_edges=tuple(groups.get("internal", ())),
            crossings=tuple(groups.get("crossing", ())),
            governed_crossings={
                name: crossing for name, crossing, _ in network.list_crossing_signals()
            },
            walking_areas=tuple(groups.get("walkingarea", ())),
            junctions={item.id: item for item in network.junctions if item.type != "internal"},
            lane_links=tuple(
                link
                for link in network.connections
                if link.from_edge in streets and link.to_edge in streets
            ),
            outlines=network.outlines,
            stripes=network.stripes,
        )

    def find_opposite_edge(self, edge: SumoEdge) -> SumoEdge | None:
        """Find the street back between the same junctions, along a common border.

        For a one-way street, it is the sidewalk at its left, if it has one.
        """
        for other in self._edges_between.get((edge.to_junction, edge.from_junction), ()):
            if (other.driving_lanes or edge.driving_lanes) and _has_common_border(edge, other):
                return other
        return None

    @cached_property
    def _edges_between(self) -> dict[tuple[str, str], list[SumoEdge]]:
        found: dict[tuple[str, str], list[SumoEdge]] = {}
        for edge in self.edges.values():
            found.setdefault((edge.from_junction, edge.to_junction), []).append(edge)
        return found


def _drop_point_lanes(edge: SumoEdge) -> SumoEdge:
    if edge.function == "walkingarea":
        return edge
    return replace(edge, lanes=tuple(lane for lane in edge.lanes if len(lane.centre) > 1))


def _has_common_border(edge: SumoEdge, other: SumoEdge) -> bool:
    first, second = (shapely.LineString(e.innermost_lane.left_border[:, :2]) for e in (edge, other))
    return bool(first.distance(second.interpolate(0.5, normalized=True)) < MAX_BORDER_GAP_M)

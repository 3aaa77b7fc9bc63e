"""Streets, movements and signals of an imported network, as declared roads have them."""

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import shapely
from advercity_dsl import MapNetwork
from advercity_dsl.road import Movement, StripKind

from advercity.geometry.polyline import StationedPolyline, drop_repeated_points
from advercity.roads.imported_network import ImportedNetwork
from advercity.roads.network_file import (
    LaneConnection,
    SignalProgram,
    SumoEdge,
    parse_packed_network,
)
from advercity.roads.streets import StreetLayout, StripLayout, approach_name, parse_edge_id
from advercity.roads.sumo_xml import pack_network, unpack_network

HEADING_SPAN_M = 2.0
"""Length of the chord from which a heading of an axis is computed."""
STRIP_KINDS = {
    "driving": StripKind.LANE,
    "parking": StripKind.PARKING,
    "shoulder": StripKind.SHOULDER,
    "sidewalk": StripKind.SIDEWALK,
}


@dataclass(frozen=True, eq=False)
class ImportedStreets:
    """Facts about an imported network for routes through it.

    Attributes:
        streets: Streets with a driving lane, by id.
        movements: Links between driving lanes, by junction, without turning around.
        controls: Rule of right of way by junction, in the words of declared junctions.
        signals: Program and link of each movement with lights, by both of its streets.
    """

    streets: Mapping[str, StreetLayout]
    movements: Mapping[str, tuple[Movement, ...]]
    controls: Mapping[str, str]
    signals: Mapping[tuple[str, str], tuple[SignalProgram, int]]

    def have_green_together(self, junction: str, streets: Collection[str]) -> bool:
        """Return whether a junction's lights let streets go at the same time."""
        links: dict[str, list[int]] = {street: [] for street in streets}
        programs: dict[str, SignalProgram] = {}
        for item in self.movements[junction]:
            governed = self.signals.get((item.from_street, item.to_street))
            if governed and item.from_street in links:
                program, link = governed
                programs[program.light] = program
                links[item.from_street].append(link)
        return any(program.have_green_together(links.values()) for program in programs.values())


RULES = {"priority": "yield", "priority_stop": "stop", "allway_stop": "stop"}
"""Rules of right of way by SUMO's type of junction."""


@lru_cache(maxsize=8)
def read_imported_streets(packed: str) -> ImportedStreets:
    """Read the streets of a packed network; InputError if it is none."""
    network = parse_packed_network(packed)
    roads = ImportedNetwork.from_network(network)
    programs = {program.light: program for program in network.programs}
    links = [link for link in roads.lane_links if link.direction != "t"]
    return ImportedStreets(
        streets=build_imported_streets(roads),
        movements=_group_movements(roads, links),
        controls=_find_controls(roads),
        signals={
            (approach_name(link.from_edge), approach_name(link.to_edge)): (
                programs[link.traffic_light],
                link.link_index,
            )
            for link in links
            if link.traffic_light in programs
        },
    )


def start_with_green(imported: MapNetwork, first: str, second: str) -> MapNetwork:
    """Shift the lights of a movement between two streets to begin with its green."""
    governed = read_imported_streets(imported.network).signals.get((first, second))
    if governed is None:
        return imported
    program, link = governed
    green_s = program.find_next_green_s(link, 0.0)
    net = unpack_network(imported.network)
    for item in net.iter("tlLogic"):
        if item.get("id") == program.light:
            item.set("offset", f"{program.offset_s - green_s:g}")
    return imported.model_copy(update={"network": pack_network(net)})


def _find_controls(net: ImportedNetwork) -> dict[str, str]:
    """Find the rule of right of way of every junction by SUMO's type; none where no link yields."""
    yielded = {
        net.edges[link.from_edge].to_junction for link in net.lane_links if link.state != "M"
    }
    rules = {name: RULES.get(item.type, "none") for name, item in net.junctions.items()}
    lights = {
        name: "signals"
        for name, item in net.junctions.items()
        if item.type.startswith("traffic_light")
    }
    return dict.fromkeys(rules, "none") | {name: rules[name] for name in yielded} | lights


def build_imported_streets(network: ImportedNetwork) -> dict[str, StreetLayout]:
    """Build the streets of a network, without edges closed to cars or without a name."""
    directions: dict[str, dict[bool, SumoEdge]] = {}
    for edge in network.edges.values():
        try:
            street, along = parse_edge_id(edge.id)
        except KeyError:
            continue
        directions.setdefault(street, {})[along] = edge
    return {
        name: _build_street(name, found[True], found.get(False))
        for name, found in directions.items()
        if True in found and found[True].driving_lanes
    }


def _build_street(name: str, edge: SumoEdge, opposite: SumoEdge | None) -> StreetLayout:
    axis = drop_repeated_points(edge.driving_lanes[-1].left_border)
    line = StationedPolyline.from_points(axis)
    plane = StationedPolyline.from_points(axis[:, :2])
    gap_m = 0.0
    if opposite is not None:
        border = shapely.LineString(opposite.innermost_lane.left_border[:, :2])
        gap_m = border.distance(shapely.Point(plane.points_at(plane.length_m / 2)))
    return StreetLayout(
        id=name,
        begins=edge.from_junction,
        ends=edge.to_junction,
        axis=axis,
        headings=np.unwrap(plane.headings_at(plane.stations_m, span_m=HEADING_SPAN_M)),
        stations=line.stations_m,
        left_strips=tuple(_build_strips(opposite, gap_m, 1.0)) if opposite else (),
        right_strips=tuple(_build_strips(edge, 0.0, -1.0)),
        axis_paint=None,
        speed_limit_m_s=edge.driving_lanes[0].speed_limit_m_s,
    )


def _build_strips(edge: SumoEdge, inner_m: float, sign: float) -> Iterator[StripLayout]:
    """Build strips from the innermost lane outwards."""
    innermost = edge.lanes.index(edge.innermost_lane)
    number = 0
    for lane in edge.lanes[innermost::-1]:
        kind = STRIP_KINDS[lane.kind]
        number += kind is StripKind.LANE
        yield StripLayout(
            kind=kind,
            inner_t=sign * inner_m,
            outer_t=sign * (inner_m + lane.width_m),
            paint=None,
            lane_number=number if kind is StripKind.LANE else 0,
        )
        inner_m += lane.width_m


def _group_movements(
    network: ImportedNetwork, links: list[LaneConnection]
) -> dict[str, tuple[Movement, ...]]:
    numbers = {
        lane.id: number
        for edge in network.edges.values()
        for number, lane in enumerate(reversed(edge.driving_lanes), start=1)
    }
    found: dict[str, list[Movement]] = {}
    for link in links:
        if link.origin in numbers and link.target in numbers:
            junction = network.edges[link.from_edge].to_junction
            found.setdefault(junction, []).append(
                Movement(
                    approach_name(link.from_edge),
                    numbers[link.origin],
                    approach_name(link.to_edge),
                    numbers[link.target],
                )
            )
    return {junction: tuple(movements) for junction, movements in found.items()}

"""Heights of bridges and tunnels: OpenStreetMap only has their order from below.

Streets that cross without a common node are a height apart for each layer between them. Decks are
lifted and tunnels lowered, with ramps along all connected streets. So tunnels become open cuttings.
Bridges over other things than streets, as over rivers, stay level.
"""

import heapq
import math
from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence, Set
from dataclasses import dataclass
from itertools import pairwise
from operator import attrgetter
from xml.etree.ElementTree import Element, SubElement

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from advercity.foreign.ledger import Ledger
from advercity.geometry.polyline import Points, polyline_stations
from advercity.roads.osm_map import list_nodes, read_tags

LAYER_HEIGHT_M = 5.5
"""Height of a layer: 4.5 m are left free above main roads in most of Europe, the rest is a deck."""
MIN_CLEARANCE_M = 4.0
"""Height of the highest lorries; the least height between two crossing streets."""
GRADES = (0.06, 0.08, 0.12)
"""Steepest grades of ramps; the first with which all ramps have room is taken."""
RAMP_STEP_M = 12.0
"""Distance between places of a ramp whose heights are computed."""
LEVEL_JUNCTION_M = 10.0
"""Distance from a junction in which all is level: netconvert gives it the height of its node."""
DECK_HALF_M = 15.0
"""Half the length of a deck without a tag of a bridge or tunnel."""
NODE_TOLERANCE_M = 0.01
SAME_PLACE_M = 0.5
"""Distance from a common node within which two ways meet rather than cross."""
MAX_LAYER = 5
"""OpenStreetMap's layers are -5 to 5."""
Places = dict[str, tuple[float, float]]
"""East and north of nodes by their id, metres."""


@dataclass(frozen=True, eq=False)
class _Street:
    """A way for cars; `is_structure` if all of it is a bridge or a tunnel."""

    way: Element
    line: shapely.LineString
    layer: int
    is_structure: bool

    @property
    def name(self) -> str:
        return read_tags(self.way).get("name") or f"way {self.way.get('id')}"


@dataclass(frozen=True, eq=False)
class _Overpass:
    """A place where a street is above another without a junction."""

    upper: _Street
    lower: _Street
    place: shapely.Point

    def list_decks(self) -> Iterator["_Deck"]:
        """Yield the parts of its streets off the ground."""
        near = shapely.buffer(self.place, DECK_HALF_M)
        for street, is_off in (
            (self.upper, self.upper.layer > 0),
            (self.lower, self.lower.layer < 0),
        ):
            if is_off:
                line = street.line if street.is_structure else street.line.intersection(near)
                yield _Deck(street, line)


@dataclass(frozen=True, eq=False)
class _Deck:
    """A part of a street off the ground."""

    street: _Street
    line: BaseGeometry

    @property
    def height_m(self) -> float:
        return self.street.layer * LAYER_HEIGHT_M

    def list_nodes(self, places: Places) -> Iterator[str]:
        """Yield the nodes of its street on it."""
        for name in list_nodes(self.street.way):
            if self.line.distance(shapely.Point(places[name])) < NODE_TOLERANCE_M:
                yield name


def set_heights(plan: Element, streets: Set[str], ledger: Ledger) -> None:
    """Give the nodes of an extract heights (`ele`), in place, and add nodes along ramps.

    Args:
        plan: The extract in metres.
        streets: Ids of the ways for cars.
        ledger: Record of overpasses whose ramps have no room.
    """
    places = {
        node.attrib["id"]: (float(node.attrib["lon"]), float(node.attrib["lat"]))
        for node in plan.iter("node")
    }
    ways = [way for way in plan.iter("way") if way.get("id") in streets]
    overpasses = list(_find_overpasses(ways, places, ledger))
    if not overpasses:
        return
    decks = [deck for item in overpasses for deck in item.list_decks()]
    reach_m = max(_find_ramp_length(deck.height_m, GRADES[0]) for deck in decks)
    zone = shapely.buffer(shapely.union_all([deck.line for deck in decks]), reach_m)
    for way in ways:
        _add_nodes(plan, way, places, zone)
    heights, tight = _solve_heights(ways, places, decks, overpasses)
    for item in tight:
        name = f"room for the ramps of {item.upper.name} over {item.lower.name}"
        ledger.leave_out(name, plural=name, at=item.upper.way)
    for node in plan.iter("node"):
        height_m = heights.get(node.attrib["id"], 0.0)
        if height_m:
            SubElement(node, "tag", k="ele", v=f"{height_m:.3f}")


def _find_overpasses(
    ways: Iterable[Element], places: Places, ledger: Ledger
) -> Iterator[_Overpass]:
    streets = [_read_street(way, places) for way in ways if len(_locate(way, places)) > 1]
    tree = shapely.STRtree([street.line for street in streets])
    for index, street in enumerate(streets):
        for other in tree.query(street.line, predicate="intersects"):
            if other <= index:
                continue
            lower, upper = sorted((street, streets[other]), key=attrgetter("layer"))
            for place in _find_crossings(lower, upper, places):
                if lower.layer != upper.layer:
                    yield _Overpass(upper, lower, place)
                else:
                    ledger.leave_out(
                        "crossing of streets of one layer without a junction",
                        plural="crossings of streets of one layer without a junction",
                        at=upper.way,
                    )


def _find_crossings(first: _Street, second: _Street, places: Places) -> Iterator[shapely.Point]:
    common = {*list_nodes(first.way)} & {*list_nodes(second.way)} & places.keys()
    meet = shapely.MultiPoint([places[name] for name in sorted(common)])
    for part in shapely.get_parts(first.line.intersection(second.line)):
        place = part.interpolate(0.5, normalized=True) if part.geom_type != "Point" else part
        if meet.is_empty or place.distance(meet) > SAME_PLACE_M:
            yield place


def _read_street(way: Element, places: Places) -> _Street:
    tags = read_tags(way)
    is_bridge, is_tunnel = (tags.get(key, "no") != "no" for key in ("bridge", "tunnel"))
    try:
        layer = int(tags.get("layer", ""))
    except ValueError:
        layer = is_bridge - is_tunnel
    layer = max(-MAX_LAYER, min(layer, MAX_LAYER))
    line = shapely.LineString(_locate(way, places))
    return _Street(way, line, layer, is_bridge or is_tunnel)


def _locate(way: Element, places: Places) -> Points:
    found = [places[name] for name in list_nodes(way) if name in places]
    return np.array(found).reshape(-1, 2)


def _add_nodes(plan: Element, way: Element, places: Places, zone: shapely.Geometry) -> None:
    """Add nodes to a way in a zone, to shorten the steps between nodes there."""
    first_node = [item.tag for item in plan].index("node")
    names = [name for name in list_nodes(way) if name in places]
    for item in way.findall("nd"):
        way.remove(item)
    number = 0
    for name, following in pairwise(names):
        SubElement(way, "nd", ref=name)
        ends = np.array([places[name], places[following]])
        if not shapely.LineString(ends).intersects(zone):
            continue
        count = math.ceil(float(np.linalg.norm(ends[1] - ends[0])) / RAMP_STEP_M)
        for share in np.arange(1, count) / count:
            while (added := f"{way.get('id', '').lstrip('-')}{number:06d}") in places:
                number += 1
            east, north = (float(value) for value in ends[0] + share * (ends[1] - ends[0]))
            places[added] = (east, north)
            place = {"id": added, "lon": f"{east:.4f}", "lat": f"{north:.4f}"}
            plan.insert(first_node, Element("node", place))
            SubElement(way, "nd", ref=added)
    for name in names[-1:]:
        SubElement(way, "nd", ref=name)


def _solve_heights(
    ways: Sequence[Element],
    places: Places,
    decks: Sequence[_Deck],
    overpasses: Sequence[_Overpass],
) -> tuple[dict[str, float], list[_Overpass]]:
    """Compute heights of nodes, and the overpasses without room below."""
    links = _link_nodes(ways, places)
    starts: dict[float, list[str]] = defaultdict(list)
    for deck in decks:
        starts[deck.height_m] += deck.list_nodes(places)
    distances = {
        height_m: _measure(links, names, _find_ramp_length(height_m, GRADES[0]))
        for height_m, names in starts.items()
    }
    heights: dict[str, float] = {}
    tight: list[_Overpass] = []
    for grade in GRADES:
        heights = {name: _find_height(name, distances, grade) for name in links}
        tight = [
            item for item in overpasses if _find_clearance(item, places, heights) < MIN_CLEARANCE_M
        ]
        if not tight:
            break
    return heights, tight


def _link_nodes(ways: Iterable[Element], places: Places) -> dict[str, list[tuple[str, float]]]:
    """Link the nodes of streets with their neighbours, and the lengths of ramps to them."""
    steps = [step for way in ways for step in pairwise(list_nodes(way))]
    counts = Counter(name for step in steps for name in step)
    links: dict[str, list[tuple[str, float]]] = defaultdict(list)
    for first, second in steps:
        level_m = LEVEL_JUNCTION_M * sum(counts[name] > 2 for name in (first, second))
        length_m = max(math.dist(places[first], places[second]) - level_m, 0.0)
        links[first].append((second, length_m))
        links[second].append((first, length_m))
    return links


def _measure(
    links: Mapping[str, Sequence[tuple[str, float]]], starts: Iterable[str], most_m: float
) -> dict[str, float]:
    """Measure distances along streets from the nearest of some nodes, up to a limit."""
    found: dict[str, float] = {}
    queue = [(0.0, name) for name in starts]
    while queue:
        distance_m, name = heapq.heappop(queue)
        if name in found or distance_m > most_m:
            continue
        found[name] = distance_m
        for following, length_m in links[name]:
            heapq.heappush(queue, (distance_m + length_m, following))
    return found


def _find_ramp_length(height_m: float, grade: float) -> float:
    """Compute the length of a ramp, half a wave of a cosine, by its steepest grade."""
    return abs(height_m) * math.pi / (2 * grade)


def _find_height(name: str, distances: Mapping[float, Mapping[str, float]], grade: float) -> float:
    """Find the height of a node: the highest ramp less the deepest cutting."""
    ramps = [0.0]
    for height_m, found in distances.items():
        share = found.get(name, math.inf) / _find_ramp_length(height_m, grade)
        if share < 1:
            ramps.append(height_m * 0.5 * (1 + math.cos(math.pi * share)))
    return max(ramps) + min(ramps)


def _find_clearance(item: _Overpass, places: Places, heights: Mapping[str, float]) -> float:
    upper_m, lower_m = (
        _interpolate_height(street, item.place, places, heights)
        for street in (item.upper, item.lower)
    )
    return upper_m - lower_m


def _interpolate_height(
    street: _Street, place: shapely.Point, places: Places, heights: Mapping[str, float]
) -> float:
    names = list_nodes(street.way)
    points = np.array([places[name] for name in names])
    station_m = float(shapely.LineString(points).project(place))
    return float(np.interp(station_m, polyline_stations(points), [heights[name] for name in names]))

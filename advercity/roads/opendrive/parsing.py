"""Parsing of OpenDRIVE documents into records.

Elements at places outside the standard are refused with their line. The table of the standard
covers valid parts without use.
"""

import math
from collections.abc import Collection, Iterator
from xml.etree.ElementTree import Element

import numpy as np

from advercity.errors import InputError
from advercity.foreign.xml_documents import get_line
from advercity.roads.opendrive.document import (
    Connection,
    Contact,
    CrossSection,
    Crosswalk,
    Header,
    Junction,
    Lane,
    LaneSection,
    OpenDriveMap,
    PlanGeometry,
    Road,
    RoadLink,
    Signal,
    SpeedLimit,
)
from advercity.roads.opendrive.profiles import Cubic, Profile
from advercity.roads.opendrive.short_roads import bridge_short_roads

MAX_ROADS_M = 500_000.0
"""Total length of the roads of a map; a larger one would fill the memory."""
MIN_GEOMETRY_M = 0.001
"""Shorter geometries, which editors leave between others, may have any curvature."""
MAX_CURVATURE_PER_M = 100.0
MAX_TURN_RAD = 50.0
"""Largest change of direction of a spiral: eight turns."""
MAX_VALUE = 1e12
"""Larger numbers are no lengths, and their cubes no numbers."""
UNIT_M_S = {"m/s": 1.0, "": 1.0, "km/h": 1 / 3.6, "mph": 0.44704}
UNLIMITED_M_S = 130 / 3.6
"""Speed on roads without a limit: the advised one on such motorways."""
LIGHT_TYPES = frozenset(
    ["1000001", *(str(number) for number in range(1_000_007, 1_000_014)), "1000020"]
)
"""Types of signals for vehicles' lights, of the catalogue `OpenDRIVE`."""
SKIPPED_JUNCTIONS = frozenset(["virtual", "crossing"])
"""Types of omitted junctions; their connecting roads are left out, too."""
POLYNOMIAL_NAMES = {
    "poly3": ("a", "b", "c", "d"),
    "paramPoly3": ("aU", "bU", "cU", "dU", "aV", "bV", "cV", "dV"),
    "arc": ("curvature",),
    "spiral": ("curvStart", "curvEnd"),
    "line": (),
}


def parse_opendrive(root: Element) -> OpenDriveMap:
    """Parse a document.

    Raises:
        InputError: An element lacks an attribute, or it has an invalid value.
    """
    skipped = {
        item.get("id", "")
        for item in root.iter("junction")
        if item.get("type") in SKIPPED_JUNCTIONS
    }
    lights = {_text(item, "id") for item in root.iter("signal") if item.get("type") in LIGHT_TYPES}
    roads = [_parse_road(item, lights) for item in root.iter("road")]
    if sum(road.length_m for road in roads) > MAX_ROADS_M:
        raise InputError(f"its roads are longer than {MAX_ROADS_M / 1000:g} km together")
    junctions = [
        Junction(_text(item, "id"), tuple(_parse_connections(item)))
        for item in root.iter("junction")
        if item.get("id") not in skipped
    ]
    kept = {road.id: road for road in roads if road.junction not in skipped}
    document = OpenDriveMap(
        header=_parse_header(root.find("header")),
        roads=kept,
        junctions={item.id: item for item in junctions},
    )
    return bridge_short_roads(document)


def _parse_header(item: Element | None) -> Header:
    if item is None:
        return Header("", (0.0, 0.0, 0.0), 0.0)
    offset = item.find("offset")
    place = [0.0] * 4
    if offset is not None:
        place = [_number(offset, name, 0.0) for name in ("x", "y", "z", "hdg")]
    x_m, y_m, z_m, heading = place
    return Header((item.findtext("geoReference") or "").strip(), (x_m, y_m, z_m), heading)


def _parse_road(item: Element, lights: Collection[str]) -> Road:
    length_m = _number(item, "length")
    rule = item.get("rule", "RHT")
    if rule not in ("RHT", "LHT"):
        raise _fault(item, f"rule '{rule[:20]}' is neither RHT nor LHT")
    lanes = item.find("lanes")
    if lanes is None or lanes.find("laneSection") is None:
        raise _fault(item, f"road '{item.get('id', '')[:40]}' has no lanes")
    sections = sorted(
        (_parse_section(section) for section in lanes.iter("laneSection")),
        key=lambda section: section.begins_m,
    )
    pieces = sorted(item.iterfind("planView/geometry"), key=lambda piece: _number(piece, "s"))
    if not pieces:
        raise _fault(item, f"road '{item.get('id', '')[:40]}' has no geometry")
    geometries = [
        _parse_geometry(piece) for piece in pieces if _number(piece, "length") > MIN_GEOMETRY_M
    ]
    return Road(
        id=_text(item, "id"),
        name=item.get("name", ""),
        # A road has no place beyond its geometry.
        length_m=min(length_m, max((it.begins_m + it.length_m for it in geometries), default=0.0)),
        junction=item.get("junction", "-1"),
        is_left_handed=rule == "LHT",
        predecessor=_parse_link(item.find("link/predecessor")),
        successor=_parse_link(item.find("link/successor")),
        speeds=tuple(_parse_road_speeds(item)),
        geometries=tuple(geometries),
        elevation=_parse_profile(item.iterfind("elevationProfile/elevation"), "s"),
        superelevation=_parse_profile(item.iterfind("lateralProfile/superelevation"), "s"),
        cross_sections=_parse_cross_sections(item),
        lane_offset=_parse_profile(lanes.iterfind("laneOffset"), "s"),
        sections=tuple(sections),
        lights=tuple(_parse_lights(item, lights)),
        crosswalks=tuple(_parse_crosswalks(item)),
        line=get_line(item),
    )


def _parse_link(item: Element | None) -> RoadLink | None:
    if item is None or not item.get("elementId"):
        return None
    kind = item.get("elementType", "road")
    if kind not in ("road", "junction"):
        raise _fault(item, f"elementType '{kind[:20]}' is neither road nor junction")
    return RoadLink(kind, _text(item, "elementId"), _parse_contact(item))


def _parse_contact(item: Element) -> Contact:
    contact = item.get("contactPoint", "start")
    if contact not in ("start", "end"):
        raise _fault(item, f"contactPoint '{contact[:20]}' is neither start nor end")
    return contact


def _parse_road_speeds(road: Element) -> Iterator[SpeedLimit]:
    for item in sorted(road.iterfind("type"), key=lambda item: _number(item, "s", 0.0)):
        speed = item.find("speed")
        limit = None if speed is None else _parse_speed(speed)
        yield SpeedLimit(_number(item, "s", 0.0), limit)


def _parse_speed(item: Element) -> float | None:
    text = item.get("max", "undefined").strip()
    if text == "no limit":
        return UNLIMITED_M_S
    if text == "undefined":
        return None
    unit = item.get("unit", "").strip()
    if unit not in UNIT_M_S:
        raise _fault(item, f"unit '{unit[:20]}' is none of m/s, km/h and mph")
    speed_m_s = _number(item, "max") * UNIT_M_S[unit]
    # Editors write 0 and -1 if no limit is known.
    return speed_m_s if speed_m_s > 0 else None


def _parse_geometry(item: Element) -> PlanGeometry:
    length_m = _number(item, "length")
    found = next((child for child in item if child.tag in POLYNOMIAL_NAMES), None)
    if found is None:
        raise _fault(item, "has no line, arc, spiral, poly3 or paramPoly3")
    values = tuple(_number(found, name) for name in POLYNOMIAL_NAMES[found.tag])
    if found.tag in ("arc", "spiral"):
        steepest = max(abs(value) for value in values)
        if steepest > MAX_CURVATURE_PER_M or (
            found.tag == "spiral" and steepest * length_m > MAX_TURN_RAD
        ):
            raise _fault(found, f"its curvature of {steepest:g} 1/m over {length_m:g} m is no road")
    return PlanGeometry(
        begins_m=_number(item, "s"),
        start=(_number(item, "x"), _number(item, "y")),
        heading=_number(item, "hdg"),
        length_m=length_m,
        shape=found.tag,
        values=values,
        is_normalized=found.get("pRange", "normalized") == "normalized",
    )


def _parse_cross_sections(road: Element) -> tuple[CrossSection, ...]:
    shapes = list(road.iterfind("lateralProfile/shape"))
    stations = sorted({_number(item, "s") for item in shapes})
    return tuple(
        CrossSection(
            station_m,
            _parse_profile((item for item in shapes if _number(item, "s") == station_m), "t"),
        )
        for station_m in stations
    )


def _parse_profile(items: Iterator[Element], begins: str) -> Profile:
    cubics = [
        Cubic(
            _number(item, begins, 0.0),
            (
                _number(item, "a", 0.0),
                _number(item, "b", 0.0),
                _number(item, "c", 0.0),
                _number(item, "d", 0.0),
            ),
        )
        for item in items
    ]
    return tuple(sorted(cubics, key=lambda cubic: cubic.begins_m))


def _parse_section(item: Element) -> LaneSection:
    lanes = [
        _parse_lane(lane) for side in ("left", "right") for lane in item.iterfind(f"{side}/lane")
    ]
    return LaneSection(_number(item, "s", 0.0), {lane.id: lane for lane in lanes if lane.id})


def _parse_lane(item: Element) -> Lane:
    return Lane(
        id=_integer(item, "id"),
        type=item.get("type", "none"),
        is_level=item.get("level", "false") in ("true", "1"),
        widths=_parse_profile(item.iterfind("width"), "sOffset"),
        borders=_parse_profile(item.iterfind("border"), "sOffset"),
        predecessors=tuple(_integer(link, "id") for link in item.iterfind("link/predecessor")),
        successors=tuple(_integer(link, "id") for link in item.iterfind("link/successor")),
        speeds=tuple(
            SpeedLimit(_number(speed, "sOffset", 0.0), _parse_speed(speed))
            for speed in item.iterfind("speed")
        ),
        line=get_line(item),
    )


def _parse_lights(road: Element, lights: Collection[str]) -> Iterator[Signal]:
    for item in road.iterfind("signals/*"):
        if item.get("id") in lights:
            yield Signal(_number(item, "s"), item.get("orientation", "none"))


def _parse_crosswalks(road: Element) -> Iterator[Crosswalk]:
    for item in road.iterfind("objects/object"):
        if item.get("type") == "crosswalk":
            station_m, left_m, heading = (_number(item, name, 0.0) for name in ("s", "t", "hdg"))
            corners = [
                (_number(corner, "u"), _number(corner, "v")) for corner in item.iter("cornerLocal")
            ]
            u, v = np.mean(corners or [(0.0, 0.0)], axis=0)
            cosine, sine = math.cos(heading), math.sin(heading)
            along_m, aside_m = float(u * cosine - v * sine), float(u * sine + v * cosine)
            yield Crosswalk(station_m + along_m, left_m + aside_m)


def _parse_connections(junction: Element) -> Iterator[Connection]:
    for item in junction.iterfind("connection"):
        linked = item.get("linkedRoad")
        yield Connection(
            incoming_road=_text(item, "incomingRoad"),
            road=linked or _text(item, "connectingRoad"),
            contact=_parse_contact(item),
            is_direct=linked is not None,
            lane_links=tuple(
                (_integer(link, "from"), _integer(link, "to")) for link in item.iterfind("laneLink")
            ),
        )


def _text(item: Element, name: str) -> str:
    found = item.get(name)
    if not found:
        raise _fault(item, f"has no attribute '{name}'")
    return found


def _number(item: Element, name: str, default: float | None = None) -> float:
    text = item.get(name)
    if text is None and default is not None:
        return default
    try:
        value = float(_text(item, name))
    except ValueError:
        value = math.nan
    if not abs(value) <= MAX_VALUE:
        raise _fault(item, f"{name} is '{(text or '')[:40]}', which is no number to build with")
    return value


def _integer(item: Element, name: str) -> int:
    value = _number(item, name)
    if value != int(value):
        raise _fault(item, f"{name} is '{value:g}', not a whole number")
    return int(value)


def _fault(item: Element, message: str) -> InputError:
    return InputError(f"line {get_line(item)}: <{item.tag}>: {message}")

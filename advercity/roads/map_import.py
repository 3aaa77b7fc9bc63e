"""Import of OpenDRIVE, OpenStreetMap and SUMO files as the SUMO network of a road."""

import tempfile
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np
from advercity_dsl import MapFile, MapNetwork, Road
from advercity_dsl.road.extent import MAX_SITE_M
from advercity_dsl.units import Point2

from advercity.errors import InputError
from advercity.foreign.ledger import Ledger
from advercity.foreign.xml_documents import parse_xml, to_xml_bytes
from advercity.roads.imported_crossings import (
    build_discards,
    marks_crossings,
    take_crosswalks,
)
from advercity.roads.map_files import read_map_file
from advercity.roads.map_names import get_map_id, read_street_names, rename_network
from advercity.roads.map_plan import MapPlan
from advercity.roads.network_file import SumoLane, SumoNetwork, parse_network
from advercity.roads.opendrive_junctions import add_outlines, detach_connecting_roads
from advercity.roads.osm_map import REMOVED_TYPE
from advercity.roads.osm_plan import plan_extract
from advercity.roads.sumo_network import run_netconvert
from advercity.roads.sumo_plan import plan_network
from advercity.roads.sumo_xml import pack_network, sanitize_network

EARTH_RADIUS_M = 6_371_000.0
MAX_MAP_DISTANCE_M = 20_000.0
"""Longest distance from the road's origin to its map; a plane fits the globe to centimetres."""
MAX_LATITUDE_DEG, MAX_LONGITUDE_DEG = 90, 180
MAX_LANE_WIDTH_M = 60.0
"""As of a declared strip."""
LANE_TYPES = """<types>
  <type id="driving" priority="1" speed="13.89" width="3.5" disallow="pedestrian"/>
  <type id="entry" priority="1" speed="22.22" width="3.5" disallow="pedestrian"/>
  <type id="exit" priority="1" speed="22.22" width="3.5" disallow="pedestrian"/>
  <type id="onRamp" priority="1" speed="22.22" width="3.5" disallow="pedestrian"/>
  <type id="offRamp" priority="1" speed="22.22" width="3.5" disallow="pedestrian"/>
  <type id="sidewalk" priority="0" speed="2.78" width="2" allow="pedestrian"/>
  <type id="parking" priority="0" speed="1.39" width="2.5" disallow="all"/>
  <type id="shoulder" priority="0" speed="1.39" width="1" disallow="all"/>
  <type id="stop" priority="0" speed="1.39" width="1" disallow="all"/>
  <type id="biking" priority="0" speed="5.56" width="1.5" disallow="all"/>
</types>
"""
"""Lane types of OpenDRIVE; by default netconvert drops most of them, sidewalks above all."""
OBJECTS_FILE = "objects.xml"
OPENDRIVE_OPTIONS = {
    "opendrive-files": "map.xml",
    "type-files": "lanes.typ.xml",
    "opendrive.curve-resolution": "1",
    "polygon-output": OBJECTS_FILE,
}
WALKED_CLASSES = "passenger,pedestrian"
NO_PROJECTION = "!"
OSM_OPTIONS = {
    "osm-files": "map.xml",
    "proj": NO_PROJECTION,
    # netconvert makes the sidewalk at the left of a one-way street an edge of its own.
    "keep-edges.by-vclass": WALKED_CLASSES,
    "remove-edges.by-type": REMOVED_TYPE,
    "osm.sidewalks": "true",
    "geometry.remove": "true",
    "junctions.join": "true",
    "tls.discard-simple": "true",
    "tls.join": "true",
    "tls.guess-signals": "true",
}
SUMO_OPTIONS = {"sumo-net-file": "map.xml"}
CAR_OPTIONS = {
    "output.street-names": "true",
    "keep-edges.by-vclass": "passenger",
    "roundabouts.guess": "true",
    "junctions.corner-detail": "8",
    "junctions.internal-link-detail": "12",
    "tls.default-type": "static",
}


def import_map(declared: MapFile, road: Road, folder: Path) -> MapNetwork:
    """Convert a map to a network.

    Its file is relative to `folder`; the road's origin locates latitudes and longitudes.

    Raises:
        InputError: The file is missing, unsafe, of another kind, too large, or without a lane for
            cars.
        RunError: `netconvert` does not run.
    """
    found = read_map_file(declared, folder)
    ledger = Ledger()
    plan = _plan_map(found.root, declared, road, ledger)
    options = _build_import_options(declared, road, plan.root)
    if declared.extent_m is not None:
        is_mirrored = plan.driving_side == "left"
        options["keep-edges.in-boundary"] = _format_extent(declared.extent_m, is_mirrored)
    converted = _convert(plan.root, options, declared)
    _check_lanes(_parse_converted(converted, declared), declared)
    marked = [*plan.crossings, *take_crosswalks(converted)]
    if marked:
        converted = _keep_marked_crossings(converted, declared, marked)
    net = sanitize_network(converted)
    rename_network(net, read_street_names(converted))
    connecting = detach_connecting_roads(found.root) if declared.source == "opendrive" else None
    if connecting is not None:
        paved = _parse_converted(_convert(connecting, OPENDRIVE_OPTIONS, declared), declared)
        add_outlines(net, paved.lanes, declared.extent_m)
    return MapNetwork(
        source=declared.source,
        sha256=found.sha256,
        network=pack_network(net),
        driving_side=plan.driving_side,
        left_out=ledger.left_out,
    )


def _plan_map(root: Element, declared: MapFile, road: Road, ledger: Ledger) -> MapPlan:
    match declared.source:
        case "osm":
            _check_places(declared, road, root)
            return plan_extract(root, road, declared, partial(_find_streets, declared), ledger)
        case "sumo":
            try:
                return plan_network(root, ledger)
            except InputError as error:
                raise InputError(f"{declared.file}: {error}") from None
        case "opendrive":
            return MapPlan(root)


def _parse_converted(net: Element, declared: MapFile) -> SumoNetwork:
    """Parse what netconvert has written: it also writes numbers of a map that are none."""
    try:
        return parse_network(net)
    except ValueError as error:
        raise InputError(f"{declared.file}: netconvert cannot use it: {error}") from None


def _check_lanes(network: SumoNetwork, declared: MapFile) -> None:
    """Check that a network has room for a car, and is no larger than a site may be."""
    # A world of a shorter lane would have none: points of its line that are so close are left out.
    if not any(lane.is_driving_lane and len(lane.centre) > 1 for lane in network.lanes):
        raise InputError(f"{declared.file}: has no lane for cars{_describe_extent(declared)}")
    for lane in network.lanes:
        if not 0 < lane.width_m <= MAX_LANE_WIDTH_M:
            raise InputError(
                f"{declared.file}: has a lane that is {lane.width_m:g} m wide,"
                f" {_describe_lane(lane)}; lanes are at most {MAX_LANE_WIDTH_M:g} m wide"
            )
    points = np.concatenate([lane.shape for lane in network.lanes])
    directions = ("from west to east", "from south to north")
    for size_m, direction in zip(np.ptp(points[:, :2], axis=0), directions, strict=True):
        if not size_m <= MAX_SITE_M:
            raise InputError(
                f"{declared.file}: its lanes are {size_m:g} m {direction}; the limit is"
                f" {MAX_SITE_M:g} m, to which `extent_m` cuts a map"
            )
    height_m = points[np.abs(points[:, 2]).argmax(), 2]
    if not abs(height_m) <= MAX_SITE_M:
        raise InputError(
            f"{declared.file}: has a lane {height_m:g} m above zero; the limit is {MAX_SITE_M:g} m"
        )


def _find_streets(declared: MapFile, plan: Element) -> set[str]:
    """Find the ids of the ways that cars may use, as netconvert reads their tags."""
    options = {"osm-files": "map.xml", "keep-edges.by-vclass": "passenger", "proj": NO_PROJECTION}
    found = _convert(plan, options, declared)
    return {get_map_id(item.attrib["id"]) for item in found.iter("edge")}


def _keep_marked_crossings(
    converted: Element, declared: MapFile, marked: list[tuple[float, float]]
) -> Element:
    """Remove the crossings of a network that are not near those of the map."""
    discards = build_discards(converted, parse_network(converted), marked)
    if discards is None:
        return converted
    # Of edges for pedestrians alone, only those that are to stay have been converted.
    options = CAR_OPTIONS | SUMO_OPTIONS | {"keep-edges.by-vclass": WALKED_CLASSES}
    options |= {"connection-files": "crossings.con.xml"}
    return _convert(converted, options, declared, {"crossings.con.xml": to_xml_bytes(discards)})


def _convert(
    root: Element,
    options: Mapping[str, str],
    declared: MapFile,
    files: Mapping[str, bytes] | None = None,
) -> Element:
    """Convert a document with options that may name further files; objects of the map come last."""
    with tempfile.TemporaryDirectory() as name:
        work = Path(name)
        (work / "map.xml").write_bytes(to_xml_bytes(root))
        (work / "lanes.typ.xml").write_text(LANE_TYPES, encoding="utf-8")
        for file, content in (files or {}).items():
            (work / file).write_bytes(content)
        output = work / "road.net.xml"
        outcome = run_netconvert(options, output)
        if not outcome.succeeded:
            why = f"{_find_first_error(outcome.messages)}{_describe_extent(declared)}"
            raise InputError(f"{declared.file}: netconvert cannot use it: {why}")
        net = parse_xml(output.read_bytes())
        objects = work / OBJECTS_FILE
        if objects.exists():
            net.extend(parse_xml(objects.read_bytes()))
        return net


def _build_import_options(declared: MapFile, road: Road, root: Element) -> dict[str, str]:
    options = dict(CAR_OPTIONS)
    # Where a map has no crossings, junctions of towns get some, those in the country none. Where it
    # has, they confirm what is guessed, since netconvert does not take them over.
    guesses = road.land_use == "urban" or marks_crossings(root)
    options["crossings.guess"] = str(guesses).lower()
    match declared.source:
        case "opendrive":
            options |= OPENDRIVE_OPTIONS
        case "osm":
            options |= OSM_OPTIONS
        case "sumo":
            options |= SUMO_OPTIONS
    return options


def _format_extent(extent_m: tuple[Point2, Point2], is_mirrored: bool) -> str:
    """Format a rectangle of the world in the plan frame, which is mirrored for left-hand maps."""
    corners = np.array(extent_m) * (1.0, -1.0 if is_mirrored else 1.0)
    box = (*corners.min(axis=0).tolist(), *corners.max(axis=0).tolist())
    return ",".join(f"{value:.3f}" for value in box)


def _check_places(declared: MapFile, road: Road, root: Element) -> None:
    """Check that an extract's nodes are on the globe, and near the road's origin."""
    try:
        nodes = [
            (float(item.attrib["lat"]), float(item.attrib["lon"])) for item in root.iter("node")
        ]
    except (KeyError, ValueError):
        raise InputError(f"{declared.file}: has a node without latitude and longitude") from None
    if not nodes:
        raise InputError(f"{declared.file}: has no nodes")
    for latitude, longitude in nodes:
        if not (abs(latitude) <= MAX_LATITUDE_DEG and abs(longitude) <= MAX_LONGITUDE_DEG):
            raise InputError(
                f"{declared.file}: has a node at latitude {latitude:g} and longitude"
                f" {longitude:g}; latitudes are -{MAX_LATITUDE_DEG} to {MAX_LATITUDE_DEG} degrees,"
                f" longitudes -{MAX_LONGITUDE_DEG} to {MAX_LONGITUDE_DEG}"
            )
    latitude, longitude = np.mean(nodes, axis=0)
    north, east = np.radians([latitude - road.origin_lat_deg, longitude - road.origin_lon_deg])
    away = EARTH_RADIUS_M * float(np.hypot(north, east * np.cos(np.radians(latitude))))
    if not away < MAX_MAP_DISTANCE_M:
        raise InputError(
            f"{declared.file}: is {away / 1000:.0f} km from the road's origin; declare"
            f" `origin_lat_deg: {latitude:.5f}` and `origin_lon_deg: {longitude:.5f}`, its middle"
        )


def _find_first_error(messages: str) -> str:
    """Find netconvert's first error message, else its last line."""
    lines = [line.strip() for line in messages.splitlines() if line.strip()]
    errors = [line for line in lines if line.startswith("Error")]
    return (errors or lines[-1:] or ["it printed nothing"])[0].removeprefix("Error: ")[:300]


def _describe_lane(lane: SumoLane) -> str:
    east_m, north_m = lane.shape[0, :2]
    return f"at {east_m:.6g} m east and {north_m:.6g} m north"


def _describe_extent(declared: MapFile) -> str:
    return "" if declared.extent_m is None else " (within `extent_m`)"

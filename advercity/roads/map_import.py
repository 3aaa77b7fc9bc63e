"""Import of OpenDRIVE, OpenStreetMap and SUMO files as the SUMO network of a road."""

import tempfile
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np
import shapely
from advercity_dsl import MapFile, MapNetwork, Road
from advercity_dsl.road.extent import MAX_SITE_M
from advercity_dsl.units import Point2
from shapely.geometry.base import BaseGeometry

from advercity.errors import InputError
from advercity.foreign.ledger import Ledger
from advercity.foreign.xml_documents import parse_xml, to_xml_bytes
from advercity.roads.imported_crossings import (
    build_confirmed,
    build_discards,
    marks_crossings,
)
from advercity.roads.map_files import LoadedMap, read_map_file
from advercity.roads.map_names import get_map_id, read_street_names, rename_network
from advercity.roads.map_plan import MapPlan
from advercity.roads.network_file import SumoLane, SumoNetwork, parse_network
from advercity.roads.opendrive.network import PlainNetwork, build_plain_network, complete_network
from advercity.roads.opendrive.omissions import record_omissions
from advercity.roads.opendrive.parsing import parse_opendrive
from advercity.roads.opendrive.placing import PlacedMap, place_map
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
WALKED_CLASSES = "passenger,pedestrian"
NO_PROJECTION = "!"
OSM_OPTIONS = {
    "osm-files": "map.xml",
    "proj": NO_PROJECTION,
    # netconvert makes the sidewalk at the left of a one-way street an edge of its own.
    "keep-edges.by-vclass": WALKED_CLASSES,
    "remove-edges.by-type": REMOVED_TYPE,
    "osm.sidewalks": "true",
    "osm.elevation": "true",
    "geometry.remove": "true",
    "junctions.join": "true",
    "tls.discard-simple": "true",
    "tls.join": "true",
    "tls.guess-signals": "true",
}
SUMO_OPTIONS = {"sumo-net-file": "map.xml"}
JUNCTION_OPTIONS = {
    "roundabouts.guess": "true",
    "junctions.corner-detail": "8",
    "junctions.internal-link-detail": "12",
    "tls.default-type": "static",
}
OPENDRIVE_OPTIONS = {
    "node-files": "nodes.xml",
    "edge-files": "edges.xml",
    "connection-files": "connections.xml",
    **JUNCTION_OPTIONS,
}
CAR_OPTIONS = {
    "output.street-names": "true",
    "keep-edges.by-vclass": "passenger",
    **JUNCTION_OPTIONS,
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
    if declared.source == "opendrive":
        return _import_opendrive(found, road, declared)
    ledger = Ledger()
    plan = _plan_map(found.root, declared, road, ledger)
    options = _build_import_options(declared, road, plan.root)
    if declared.extent_m is not None:
        options["keep-edges.in-boundary"] = _format_extent(declared.extent_m, plan)
    converted = _convert(plan.root, options, declared)
    _check_lanes(_parse_converted(converted, declared), declared)
    if plan.crossings:
        converted = _keep_marked_crossings(converted, declared, plan.crossings)
    net = sanitize_network(converted)
    rename_network(net, read_street_names(converted))
    return MapNetwork(
        source=declared.source,
        sha256=found.sha256,
        network=pack_network(net),
        offset_m=plan.origin_m,
        place=plan.place,
        driving_side=plan.driving_side,
        left_out=ledger.left_out,
    )


def _plan_map(root: Element, declared: MapFile, road: Road, ledger: Ledger) -> MapPlan:
    if declared.source == "osm":
        _check_places(declared, road, root)
        return plan_extract(root, road, declared, partial(_find_streets, declared), ledger)
    try:
        return plan_network(root, ledger)
    except InputError as error:
        raise InputError(f"{declared.file}: {error}") from None


def _import_opendrive(found: LoadedMap, road: Road, declared: MapFile) -> MapNetwork:
    ledger = Ledger()
    try:
        record_omissions(found.root, ledger)
        placed = place_map(parse_opendrive(found.root))
        plain = build_plain_network(placed.document, _build_extent(declared, placed))
    except InputError as error:
        raise InputError(f"{declared.file}: {error}") from None
    if not plain.names:
        raise InputError(f"{declared.file}: has no lane for cars{_describe_extent(declared)}")
    guesses = road.land_use == "urban" or bool(plain.crosswalks)
    converted = _compile(plain, declared, guesses=guesses)
    network = _parse_converted(converted, declared)
    _check_lanes(network, declared)
    if plain.crosswalks:
        plain.documents["connections"].extend(build_confirmed(network, plain.crosswalks))
        converted = _compile(plain, declared, guesses=False)
    net = sanitize_network(converted)
    complete_network(net, plain)
    rename_network(net, plain.names)
    return MapNetwork(
        source=declared.source,
        sha256=found.sha256,
        network=pack_network(net),
        offset_m=placed.origin_m,
        place=placed.place,
        driving_side=placed.driving_side,
        left_out=ledger.left_out,
    )


def _build_extent(declared: MapFile, placed: PlacedMap) -> BaseGeometry | None:
    """Build the area that roads reach into, in the frame of a placed map."""
    if declared.extent_m is None:
        return None
    corners = np.array(declared.extent_m) - placed.origin_m
    return shapely.MultiPoint(corners * (1, -1 if placed.driving_side == "left" else 1)).envelope


def _compile(plain: PlainNetwork, declared: MapFile, *, guesses: bool) -> Element:
    files = {f"{name}.xml": to_xml_bytes(root) for name, root in plain.documents.items()}
    options = OPENDRIVE_OPTIONS | {"crossings.guess": str(guesses).lower()}
    return _run_on_files(files, options, declared)


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
    converted: Element, declared: MapFile, marked: Sequence[tuple[float, float]]
) -> Element:
    """Remove the crossings of a network that are not near those of the map."""
    discards = build_discards(parse_network(converted), marked)
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
    """Convert a document with options that may name further files."""
    return _run_on_files({"map.xml": to_xml_bytes(root), **(files or {})}, options, declared)


def _run_on_files(
    files: Mapping[str, bytes], options: Mapping[str, str], declared: MapFile
) -> Element:
    """Run netconvert on files that its options name."""
    with tempfile.TemporaryDirectory() as name:
        work = Path(name)
        for file, content in files.items():
            (work / file).write_bytes(content)
        output = work / "road.net.xml"
        outcome = run_netconvert(options, output)
        if not outcome.succeeded:
            why = f"{_find_first_error(outcome.messages)}{_describe_extent(declared)}"
            raise InputError(f"{declared.file}: netconvert cannot use it: {why}")
        return parse_xml(output.read_bytes())


def _build_import_options(declared: MapFile, road: Road, root: Element) -> dict[str, str]:
    options = dict(CAR_OPTIONS)
    # Where a map has no crossings, junctions of towns get some, those in the country none. Where it
    # has, they confirm what is guessed, since netconvert does not take them over.
    guesses = road.land_use == "urban" or marks_crossings(root)
    options["crossings.guess"] = str(guesses).lower()
    match declared.source:
        case "osm":
            options |= OSM_OPTIONS
        case _:
            options |= SUMO_OPTIONS
    return options


def _format_extent(extent_m: tuple[Point2, Point2], plan: MapPlan) -> str:
    """Format a rectangle of the map in the plan frame, which is mirrored for left-hand maps."""
    mirror = (1.0, -1.0 if plan.driving_side == "left" else 1.0)
    corners = (np.array(extent_m) - plan.origin_m) * mirror
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

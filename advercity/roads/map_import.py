"""Import of OpenDRIVE, OpenStreetMap and SUMO files as the SUMO network of a road."""

import hashlib
import tempfile
from dataclasses import dataclass
from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np
from advercity_dsl import MapFile, MapNetwork, Road

from advercity.errors import InputError, describe_cause
from advercity.roads.map_names import read_street_names, rename_network
from advercity.roads.network_file import parse_network
from advercity.roads.sumo_network import run_netconvert
from advercity.roads.sumo_xml import (
    MAX_XML_BYTES,
    pack_network,
    parse_xml,
    sanitize_network,
    to_xml_bytes,
)

ROOT_TAGS = {"opendrive": "OpenDRIVE", "osm": "osm", "sumo": "net"}
EARTH_RADIUS_M = 6_371_000.0
MAX_MAP_DISTANCE_M = 20_000.0
"""Longest distance from the road's origin to its map; a plane fits the globe to centimetres."""
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
OPENDRIVE_OPTIONS = {
    "opendrive-files": "map.xml",
    "type-files": "lanes.typ.xml",
    "opendrive.curve-resolution": "1",
}
OSM_OPTIONS = {
    "osm-files": "map.xml",
    "osm.sidewalks": "true",
    "geometry.remove": "true",
    "roundabouts.guess": "true",
    "junctions.join": "true",
    "tls.discard-simple": "true",
    "tls.join": "true",
    "tls.guess-signals": "true",
}
SUMO_OPTIONS = {"sumo-net-file": "map.xml"}
CAR_OPTIONS = {
    "output.street-names": "true",
    "keep-edges.by-vclass": "passenger",
    "junctions.corner-detail": "8",
    "junctions.internal-link-detail": "12",
    "tls.default-type": "static",
}


@dataclass(frozen=True)
class _LoadedMap:
    root: Element
    sha256: str


def import_map(declared: MapFile, road: Road, folder: Path) -> MapNetwork:
    """Convert a map to a network.

    Its file is relative to `folder`; the road's origin locates latitudes and longitudes.

    Raises:
        InputError: The file is missing, unsafe, of another kind, or without a lane for cars.
        RunError: `netconvert` does not run.
    """
    found = _read_map(declared, folder)
    options = _build_import_options(declared, road, found.root)
    with tempfile.TemporaryDirectory() as name:
        work = Path(name)
        (work / "map.xml").write_bytes(to_xml_bytes(found.root))
        (work / "lanes.typ.xml").write_text(LANE_TYPES, encoding="utf-8")
        output = work / "road.net.xml"
        outcome = run_netconvert(options, output)
        if not outcome.succeeded:
            why = f"{_find_first_error(outcome.messages)}{_describe_extent(declared)}"
            raise InputError(f"{declared.file}: netconvert cannot use it: {why}")
        converted = parse_xml(output.read_bytes())
    net = sanitize_network(converted)
    rename_network(net, read_street_names(converted))
    if not any(lane.permits("passenger") for lane in parse_network(net).lanes):
        raise InputError(f"{declared.file}: has no lane for cars{_describe_extent(declared)}")
    return MapNetwork(source=declared.source, sha256=found.sha256, network=pack_network(net))


def _read_map(declared: MapFile, folder: Path) -> _LoadedMap:
    name = Path(declared.file)
    path = folder / name
    if name.is_absolute():
        raise InputError(f"{declared.file}: is an absolute path; write it relative to this file")
    if not path.is_file():
        raise InputError(f"{declared.file}: there is no such file in {folder}")
    try:
        with path.open("rb") as stream:
            # One byte more than the limit is enough for the parser to refuse the file.
            raw = stream.read(MAX_XML_BYTES + 1)
        root = parse_xml(raw)
    except OSError as error:
        raise InputError(f"{declared.file}: cannot be read: {describe_cause(error)}") from error
    except InputError as error:
        raise InputError(f"{declared.file}: {error}") from None
    digest = hashlib.sha256(raw).hexdigest()
    if declared.sha256 not in (None, digest):
        raise InputError(
            f"{declared.file}: is not the map that this road was made for: its sha256 is {digest};"
            " fetch the right one, or check every place and declare this sha256"
        )
    if root.tag != ROOT_TAGS[declared.source]:
        fitting = next((source for source, tag in ROOT_TAGS.items() if tag == root.tag), None)
        hint = f"; say `source: {fitting}`" if fitting else ""
        raise InputError(
            f"{declared.file}: begins with <{root.tag[:40]}>, not"
            f" <{ROOT_TAGS[declared.source]}>{hint}"
        )
    return _LoadedMap(_remove_file_references(root, declared.source), digest)


def _remove_file_references(root: Element, source: str) -> Element:
    """Remove references to other files from a map."""
    if source == "sumo":
        return sanitize_network(root)
    for parent in list(root.iter()):
        for child in list(parent):
            if child.tag in ("geoReference", "include", "userData", "dataQuality"):
                parent.remove(child)
    return root


def _build_import_options(declared: MapFile, road: Road, root: Element) -> dict[str, str]:
    options = dict(CAR_OPTIONS)
    # Maps seldom hold crossings: junctions of towns have them, those in the country do not.
    options["crossings.guess"] = "true" if road.land_use == "urban" else "false"
    match declared.source:
        case "opendrive":
            options |= OPENDRIVE_OPTIONS
        case "osm":
            options |= OSM_OPTIONS | {"proj": _build_projection(declared, road, root)}
        case "sumo":
            options |= SUMO_OPTIONS
    if declared.extent_m is not None:
        corners = np.array(declared.extent_m)
        box = (*corners.min(axis=0).tolist(), *corners.max(axis=0).tolist())
        options["keep-edges.in-boundary"] = ",".join(f"{value:.3f}" for value in box)
    return options


def _build_projection(declared: MapFile, road: Road, root: Element) -> str:
    """Build a transverse Mercator projection: metres east and north of the road's origin."""
    try:
        nodes = [
            (float(item.attrib["lat"]), float(item.attrib["lon"])) for item in root.iter("node")
        ]
    except (KeyError, ValueError):
        raise InputError(f"{declared.file}: has a node without latitude and longitude") from None
    if not nodes:
        raise InputError(f"{declared.file}: has no nodes")
    latitude, longitude = np.mean(nodes, axis=0)
    north, east = np.radians([latitude - road.origin_lat_deg, longitude - road.origin_lon_deg])
    away = EARTH_RADIUS_M * float(np.hypot(north, east * np.cos(np.radians(latitude))))
    if not away < MAX_MAP_DISTANCE_M:
        raise InputError(
            f"{declared.file}: is {away / 1000:.0f} km from the road's origin; declare"
            f" `origin_lat_deg: {latitude:.5f}` and `origin_lon_deg: {longitude:.5f}`, its middle"
        )
    return (
        f"+proj=tmerc +lat_0={road.origin_lat_deg:.9f} +lon_0={road.origin_lon_deg:.9f}"
        " +k=1 +x_0=0 +y_0=0 +ellps=WGS84 +units=m +no_defs"
    )


def _find_first_error(messages: str) -> str:
    """Find netconvert's first error message, else its last line."""
    lines = [line.strip() for line in messages.splitlines() if line.strip()]
    errors = [line for line in lines if line.startswith("Error")]
    return (errors or lines[-1:] or ["it printed nothing"])[0].removeprefix("Error: ")[:300]


def _describe_extent(declared: MapFile) -> str:
    return "" if declared.extent_m is None else " (within `extent_m`)"

"""Maps from outside: an OpenDRIVE, OpenStreetMap or SUMO file becomes a road's network."""

import hashlib
import tempfile
from dataclasses import dataclass
from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np
from advercity_dsl import MapFile, MapNetwork, Road

from advercity.errors import InputError
from advercity.netconvert import netconvert
from advercity.networks import cleaned, packed
from advercity.xml_input import MAX_BYTES, read_xml, written

ROOTS = {"opendrive": "OpenDRIVE", "osm": "osm", "sumo": "net"}
EARTH_RADIUS_M = 6_371_000.0
FARTHEST_M = 20_000.0
"""From the road's origin to its map; there the plane still fits the globe to a few centimetres."""
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
"""Of OpenDRIVE: what netconvert leaves out by default, sidewalks above all, belongs to a place."""
FROM_OPENDRIVE = {
    "opendrive-files": "map.xml",
    "type-files": "lanes.typ.xml",
    "opendrive.curve-resolution": "1",
    "crossings.guess": "true",
}
FROM_OSM = {
    "osm-files": "map.xml",
    "osm.sidewalks": "true",
    "crossings.guess": "true",
    "geometry.remove": "true",
    "roundabouts.guess": "true",
    "junctions.join": "true",
    "tls.discard-simple": "true",
    "tls.join": "true",
    "tls.guess-signals": "true",
}
FROM_SUMO = {"sumo-net-file": "map.xml"}
FOR_CARS = {
    "keep-edges.by-vclass": "passenger",
    "junctions.corner-detail": "8",
    "junctions.internal-link-detail": "12",
    "tls.default-type": "static",
}


@dataclass(frozen=True)
class _Map:
    root: Element
    sha256: str


def network_of(declared: MapFile, road: Road, folder: Path) -> MapNetwork:
    """The network of a map.

    Args:
        declared: Which map.
        road: Whose it is; gives the origin of maps with latitudes and longitudes.
        folder: Of the declaration, which the map's path starts from.

    Raises:
        InputError: The file is missing, unsafe, or no such map, or holds no road for cars.
        RunError: `netconvert` does not run.
    """
    found = _read(declared, folder)
    options = _options(declared, road, found.root)
    with tempfile.TemporaryDirectory() as name:
        work = Path(name)
        (work / "map.xml").write_bytes(written(found.root))
        (work / "lanes.typ.xml").write_text(LANE_TYPES, encoding="utf-8")
        output = work / "road.net.xml"
        outcome = netconvert(options, output)
        if not outcome.succeeded:
            why = f"{_first(outcome.said)}{_within(declared)}"
            raise InputError(f"{declared.file}: netconvert cannot use it: {why}")
        net = cleaned(read_xml(output.read_bytes()))
    if not any(is_for_cars(lane) for lane in net.iter("lane")):
        raise InputError(f"{declared.file}: has no lane for cars{_within(declared)}")
    return MapNetwork(source=declared.source, sha256=found.sha256, network=packed(net))


def _read(declared: MapFile, folder: Path) -> _Map:
    name = Path(declared.file)
    path = folder / name
    if name.is_absolute():
        raise InputError(f"{declared.file}: is an absolute path; write it relative to this file")
    if not path.is_file():
        raise InputError(f"{declared.file}: there is no such file in {folder}")
    try:
        with path.open("rb") as stream:
            raw = stream.read(MAX_BYTES + 1)
        root = read_xml(raw)
    except OSError as error:
        raise InputError(f"{declared.file}: cannot be read: {error.strerror}") from error
    except InputError as error:
        raise InputError(f"{declared.file}: {error}") from None
    digest = hashlib.sha256(raw).hexdigest()
    if declared.sha256 not in (None, digest):
        raise InputError(
            f"{declared.file}: is not the map that this road was made for: its sha256 is {digest};"
            " fetch the right one, or check every place and declare this sha256"
        )
    if root.tag != ROOTS[declared.source]:
        fitting = next((source for source, tag in ROOTS.items() if tag == root.tag), None)
        hint = f"; say `source: {fitting}`" if fitting else ""
        raise InputError(
            f"{declared.file}: begins with <{root.tag[:40]}>, not <{ROOTS[declared.source]}>{hint}"
        )
    return _Map(_harmless(root, declared.source), digest)


def _harmless(root: Element, source: str) -> Element:
    """The map without references to other files."""
    if source == "sumo":
        return cleaned(root)
    for parent in list(root.iter()):
        for child in list(parent):
            if child.tag in ("geoReference", "include", "userData", "dataQuality"):
                parent.remove(child)
    return root


def _options(declared: MapFile, road: Road, root: Element) -> dict[str, str]:
    options = dict(FOR_CARS)
    match declared.source:
        case "opendrive":
            options |= FROM_OPENDRIVE
        case "osm":
            options |= FROM_OSM | {"proj": _projection(declared, road, root)}
        case "sumo":
            options |= FROM_SUMO
    if declared.extent_m is not None:
        corners = np.array(declared.extent_m)
        box = (*corners.min(axis=0).tolist(), *corners.max(axis=0).tolist())
        options["keep-edges.in-boundary"] = ",".join(f"{value:.3f}" for value in box)
    return options


def _projection(declared: MapFile, road: Road, root: Element) -> str:
    """Transverse Mercator around the road's origin: metres east and north of it."""
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
    if not away < FARTHEST_M:
        raise InputError(
            f"{declared.file}: lies {away / 1000:.0f} km from the road's origin; declare"
            f" `origin_lat_deg: {latitude:.5f}` and `origin_lon_deg: {longitude:.5f}`, its middle"
        )
    return (
        f"+proj=tmerc +lat_0={road.origin_lat_deg:.9f} +lon_0={road.origin_lon_deg:.9f}"
        " +k=1 +x_0=0 +y_0=0 +ellps=WGS84 +units=m +no_defs"
    )


def _first(said: str) -> str:
    """The first error that netconvert names, else its last words."""
    lines = [line.strip() for line in said.splitlines() if line.strip()]
    errors = [line for line in lines if line.startswith("Error")]
    return (errors or lines[-1:] or ["it says nothing"])[0].removeprefix("Error: ")[:300]


def is_for_cars(lane: Element) -> bool:
    """Whether cars may drive in a lane of a SUMO network."""
    allowed, forbidden = lane.get("allow"), lane.get("disallow", "").split()
    if allowed is not None:
        return "passenger" in allowed.split()
    return not {"passenger", "all"} & set(forbidden)


def _within(declared: MapFile) -> str:
    return "" if declared.extent_m is None else " (within `extent_m`)"

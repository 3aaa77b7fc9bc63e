"""Files of maps, checked for safe use by other programs."""

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from xml.etree.ElementTree import Element

from advercity_dsl import MapFile
from advercity_dsl.road import MapSource

from advercity.errors import InputError, describe_cause
from advercity.foreign.xml_documents import MAX_XML_BYTES, parse_xml
from advercity.roads.osm_map import read_tags

ROOT_TAGS: Mapping[MapSource, str] = {
    "opendrive": "OpenDRIVE",
    "osm": "osm",
    "lanelet2": "osm",
    "sumo": "net",
}


@dataclass(frozen=True)
class LoadedMap:
    """A map's document, and the SHA-256 of its file.

    The document of an OpenStreetMap file has no references to other files.
    """

    root: Element
    sha256: str


def read_map_file(declared: MapFile, folder: Path) -> LoadedMap:
    """Read a map, whose path is relative to a folder; InputError if it cannot be used."""
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
    source = find_source(root)
    if source != declared.source:
        hint = f"; say `source: {source}`" if source else ""
        raise InputError(f"{declared.file}: {_describe_mismatch(root, declared)}{hint}")
    if declared.source == "osm":
        # Our own readers of the other formats open no files named by a map.
        _remove_file_references(root)
    return LoadedMap(root, digest)


def is_lanelet2_file(path: Path) -> bool:
    """Whether a file is a Lanelet2 map; an unreadable file is none."""
    try:
        with path.open("rb") as stream:
            return find_source(parse_xml(stream.read(MAX_XML_BYTES + 1))) == "lanelet2"
    except (OSError, InputError):
        return False


def find_source(root: Element) -> MapSource | None:
    """Find the format of a document; None if it is no map."""
    # Lanelets are relations in OpenStreetMap's XML.
    if root.tag == "osm" and any(
        read_tags(relation).get("type") == "lanelet" for relation in root.iter("relation")
    ):
        return "lanelet2"
    return next((source for source, tag in ROOT_TAGS.items() if tag == root.tag), None)


def _describe_mismatch(root: Element, declared: MapFile) -> str:
    expected = ROOT_TAGS[declared.source]
    if root.tag == expected:
        return "has no lanelets" if declared.source == "lanelet2" else "is a Lanelet2 map"
    return f"begins with <{root.tag[:40]}>, not <{expected}>"


def _remove_file_references(root: Element) -> None:
    """Remove references to other files from a map, in place."""
    for parent in list(root.iter()):
        for child in list(parent):
            if child.tag in ("geoReference", "include", "userData", "dataQuality"):
                parent.remove(child)

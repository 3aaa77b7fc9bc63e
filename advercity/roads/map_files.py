"""Files of maps, checked so that other programs can read them safely."""

import hashlib
from dataclasses import dataclass
from pathlib import Path
from xml.etree.ElementTree import Element

from advercity_dsl import MapFile

from advercity.errors import InputError, describe_cause
from advercity.foreign.xml_documents import MAX_XML_BYTES, parse_xml

ROOT_TAGS = {"opendrive": "OpenDRIVE", "osm": "osm", "sumo": "net"}


@dataclass(frozen=True)
class LoadedMap:
    """A map's document, and the SHA-256 of its file.

    The document of an OpenDRIVE or OpenStreetMap file has no references to other files.
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
    if root.tag != ROOT_TAGS[declared.source]:
        fitting = next((source for source, tag in ROOT_TAGS.items() if tag == root.tag), None)
        hint = f"; say `source: {fitting}`" if fitting else ""
        raise InputError(
            f"{declared.file}: begins with <{root.tag[:40]}>, not"
            f" <{ROOT_TAGS[declared.source]}>{hint}"
        )
    if declared.source == "osm" and _is_lanelet2(root):
        raise InputError(
            f"{declared.file}: is a Lanelet2 map, whose lanes are relations in OpenStreetMap's XML;"
            " give an OpenDRIVE map of the place, or an extract of OpenStreetMap"
        )
    if declared.source == "osm":
        # Our own readers of the other formats open nothing that a map names.
        _remove_file_references(root)
    return LoadedMap(root, digest)


def _is_lanelet2(root: Element) -> bool:
    return any(
        tag.get("k") == "type" and tag.get("v") == "lanelet"
        for relation in root.iter("relation")
        for tag in relation.iter("tag")
    )


def _remove_file_references(root: Element) -> None:
    """Remove references to other files from a map, in place."""
    for parent in list(root.iter()):
        for child in list(parent):
            if child.tag in ("geoReference", "include", "userData", "dataQuality"):
                parent.remove(child)

"""netconvert's part of an import: documents and options in, a SUMO network out."""

import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from xml.etree.ElementTree import Element

from advercity.errors import InputError
from advercity.foreign.xml_documents import parse_xml, to_xml_bytes
from advercity.roads.sumo_network import run_netconvert

WALKED_CLASSES = "passenger,pedestrian"
JUNCTION_OPTIONS = {
    "roundabouts.guess": "true",
    "junctions.corner-detail": "8",
    "junctions.internal-link-detail": "12",
    "tls.default-type": "static",
}
CAR_OPTIONS = {
    "output.street-names": "true",
    "keep-edges.by-vclass": "passenger",
    **JUNCTION_OPTIONS,
}
NETWORK_OPTIONS = CAR_OPTIONS | {"sumo-net-file": "map.xml"}


CAUSES = {
    "No edges loaded": (
        "has no street for cars, of which service roads, tracks and footways are none; take a part"
        " of the map with streets"
    )
}
"""Errors by the begin of netconvert's own, if its text does not say what to do."""


@dataclass(frozen=True, eq=False)
class Conversion:
    """Documents by the names of their files, and netconvert's options, which name the files."""

    documents: Mapping[str, Element]
    options: Mapping[str, str]


def convert(conversion: Conversion) -> Element:
    """Run netconvert.

    Raises:
        InputError: It refuses the documents.
        RunError: It does not run.
    """
    with tempfile.TemporaryDirectory() as name:
        work = Path(name)
        for file, document in conversion.documents.items():
            (work / file).write_bytes(to_xml_bytes(document))
        output = work / "road.net.xml"
        outcome = run_netconvert(conversion.options, output)
        if not outcome.succeeded:
            error = _find_first_error(outcome.messages)
            causes = [cause for begin, cause in CAUSES.items() if error.startswith(begin)]
            raise InputError(*causes or [f"netconvert cannot use it: {error}"])
        return parse_xml(output.read_bytes())


def _find_first_error(messages: str) -> str:
    """Find netconvert's first error message, else its last line."""
    lines = [line.strip() for line in messages.splitlines() if line.strip()]
    errors = [line for line in lines if line.startswith("Error")]
    return (errors or lines[-1:] or ["it printed nothing"])[0].removeprefix("Error: ")[:300]

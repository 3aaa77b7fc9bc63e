"""The site of a scenario as OpenDRIVE 1.7, by netconvert, in the frame of the world.

netconvert follows version 1.7 but for an attribute of crosswalks; its comment has paths and times
of the machine, which are left out.
"""

from pathlib import Path
from tempfile import TemporaryDirectory
from xml.etree.ElementTree import SubElement

from advercity_dsl import Road

from advercity.errors import RunError
from advercity.foreign.xml_documents import parse_xml, to_xml_bytes
from advercity.roads.sumo_network import run_netconvert
from advercity_exports.mirrored_opendrive import mirror_opendrive
from advercity_exports.tidy_opendrive import tidy_road

OUTPUT_OPTIONS = {
    "precision": "6",
    "junctions.scurve-stretch": "0",
    "opendrive-output.straight-threshold": "0.01",
}
"""Micrometres, and curves even for bends below one degree."""
FIXED_DATE = "2000-01-01T00:00:00"
"""Replaces the time of writing: the same data gives the same bytes."""


def format_site(road: Road, network: Path) -> bytes:
    """Format a road's SUMO network as OpenDRIVE, with rule LHT where traffic is on the left.

    Args:
        road: The road, for its name, its driving side and its place on the globe.
        network: Its SUMO network, in the plan frame.

    Raises:
        RunError: netconvert cannot write it.
    """
    with TemporaryDirectory() as folder:
        written = Path(folder) / "site.xodr"
        options = {"sumo-net-file": str(network.resolve()), "opendrive-output": str(written)}
        outcome = run_netconvert(options | OUTPUT_OPTIONS, Path(folder) / "road.net.xml")
        if not outcome.succeeded or not written.is_file():
            raise RunError(
                f"{road.id}: netconvert cannot write OpenDRIVE: {outcome.messages[:300]}"
            )
        root = parse_xml(written.read_bytes())
    for street in root.iter("road"):
        tidy_road(street)
    if road.is_left_hand:
        mirror_opendrive(root)
    header = root.find("header")
    assert header is not None
    header.attrib |= {"revMinor": "7", "name": road.id, "date": FIXED_DATE}
    SubElement(header, "geoReference").text = format_projection(road)
    for item in root.iter("object"):
        item.attrib.setdefault("zOffset", "0")
    return to_xml_bytes(root)


def format_projection(road: Road) -> str:
    """Format the projection of a road's world frame for PROJ."""
    return (
        f"+proj=tmerc +lat_0={road.origin_lat_deg:.9f} +lon_0={road.origin_lon_deg:.9f}"
        " +k=1 +x_0=0 +y_0=0 +ellps=WGS84 +units=m +no_defs"
    )

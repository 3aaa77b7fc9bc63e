"""Omitted values of an OpenDRIVE document; the table of the standard has the rest."""

from xml.etree.ElementTree import Element

from advercity.foreign.ledger import Ledger
from advercity.foreign.standards import load_standard
from advercity.roads.georeference import parse_projection
from advercity.roads.opendrive.lane_types import LANE_USES
from advercity.roads.opendrive.parsing import LIGHT_TYPES, SKIPPED_JUNCTIONS

MAX_EXCESS_M = 0.1


def record_omissions(root: Element, ledger: Ledger) -> None:
    """Record all omitted parts of a document, by name."""
    load_standard("opendrive").audit(root, ledger)
    for lane in root.iter("lane"):
        _record_lane(lane, ledger)
    for item in root.iter("road"):
        if _measure_excess(item) > MAX_EXCESS_M:
            name = "part of a road beyond its geometry"
            ledger.leave_out(name, plural="parts of roads beyond their geometry", at=item)
    for item in root.iter("junction"):
        if item.get("type") in SKIPPED_JUNCTIONS:
            kind = item.get("type")
            ledger.leave_out(f"{kind} junction", at=item)
    for item in root.iter("signal"):
        if item.get("type") not in LIGHT_TYPES:
            ledger.leave_out(
                "signal that is no light", plural="signals that are no lights", at=item
            )
    for item in root.iter("object"):
        if item.get("type") != "crosswalk":
            name = "object that is no crosswalk"
            ledger.leave_out(name, plural="objects that are no crosswalks", at=item)
    for item in root.iter("geoReference"):
        if (item.text or "").strip() and parse_projection(item.text or "") is None:
            ledger.leave_out("projection that is not transverse Mercator", at=item)


def _measure_excess(road: Element) -> float:
    """Measure the excess of a road's length over its geometries together; 0 if unknown."""
    try:
        pieces = [float(item.get("length", "0")) for item in road.iterfind("planView/geometry")]
        return float(road.get("length", "0")) - sum(pieces) if pieces else 0.0
    except ValueError:
        return 0.0


def _record_lane(lane: Element, ledger: Ledger) -> None:
    kind = lane.get("type", "none")
    if lane.get("id") in (None, "0") or kind == "none":
        return
    if kind == "bidirectional":
        name = "second direction of a bidirectional lane"
        ledger.leave_out(name, plural="second directions of bidirectional lanes", at=lane)
    elif kind not in LANE_USES:
        name = f"of unknown type '{kind[:40]}'"
        ledger.leave_out(f"lane {name}", plural=f"lanes {name}", at=lane)
    elif LANE_USES[kind] is None:
        ledger.leave_out(f"{kind} lane", at=lane)

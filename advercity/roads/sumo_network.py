"""The SUMO network of a road: plain XML, compiled by SUMO's `netconvert`.

Network coordinates are world coordinates, heights included. Ids: the directed edges of a street
are `<street>+` along its axis and `<street>-` against it; junctions and traffic lights have the
declared junction's id. Every strip from the innermost driving lane outwards is a lane of its edge,
closed to traffic where it is neither a driving lane nor a sidewalk, so lateral positions hold.
"""

import os
import re
import subprocess
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from xml.etree.ElementTree import Element, SubElement

import numpy as np
import sumo
from advercity_dsl import MapNetwork
from advercity_dsl.road import Road, StripKind

from advercity.errors import InputError, RunError
from advercity.foreign.xml_documents import to_xml_bytes
from advercity.geometry import polyline
from advercity.geometry.polyline import Points
from advercity.processes import MISSING_PROGRAM, bind_to_this_process
from advercity.roads import signals
from advercity.roads.layout import ConnectingPath, JunctionLayout, RoadLayout, lay_out_road
from advercity.roads.streets import (
    StreetLayout,
    StripLayout,
    edge_strips,
    sumo_edge_id,
    sumo_lane_index,
)
from advercity.roads.sumo_xml import format_metres, format_shape, unpack_network

NETCONVERT_TIMEOUT_S = 120
NETCONVERT_OPTIONS = {
    "offset.disable-normalization": "true",
    "walkingareas": "true",
    "no-turnarounds": "true",
    "precision": "3",
    "xml-validation": "never",
}
"""World coordinates to the millimetre, and areas where pedestrians walk."""


@dataclass(frozen=True)
class NetconvertResult:
    """Success of netconvert, and its printed text."""

    succeeded: bool
    messages: str


def run_netconvert(options: Mapping[str, str], output: Path) -> NetconvertResult:
    """Run netconvert with `NETCONVERT_OPTIONS` and others, which override them.

    Files in the options are relative to the folder of `output`, the network to write.

    Raises:
        RunError: The program is missing.
    """
    chosen = {**NETCONVERT_OPTIONS, **options, "output-file": output.name}
    program = str(Path(sumo.SUMO_HOME) / "bin" / "netconvert")
    command = [program, *(word for name, value in chosen.items() for word in (f"--{name}", value))]
    try:
        done = subprocess.run(  # noqa: S603  the program is the wheel's own
            bind_to_this_process(command),
            cwd=output.parent,
            # It warns of a user's missing locale, and a warning is an error here.
            env={**os.environ, "SUMO_HOME": sumo.SUMO_HOME, "LC_ALL": "C"},
            capture_output=True,
            text=True,
            errors="replace",  # messages quote names from maps, in any encoding
            timeout=NETCONVERT_TIMEOUT_S,
            check=False,
        )
    except subprocess.TimeoutExpired:
        return NetconvertResult(False, f"Error: it takes longer than {NETCONVERT_TIMEOUT_S} s")
    except OSError as error:
        raise _explain_missing_program(str(error)) from error
    if done.returncode == MISSING_PROGRAM:
        raise _explain_missing_program(done.stderr.strip())
    succeeded = done.returncode == 0 and output.exists()
    messages = done.stderr.strip()
    return NetconvertResult(succeeded, messages or ("" if succeeded else done.stdout.strip()))


def _explain_missing_program(cause: str) -> RunError:
    return RunError(f"netconvert does not run: {cause}; is eclipse-sumo installed?")


MAX_GRADE_PERCENT = 30
"""netconvert warns of steeper edges, and a warning is an error here."""
MAX_SPEED_M_S = 60
SPEED_WARNINGS = (
    "tls.minor-left.max-speed",
    "junctions.limit-turn-speed.warn.straight",
    "junctions.limit-turn-speed.warn.turn",
)
"""Options with the speeds from which netconvert warns of left turns across traffic and of bends in
junctions. The limits of country roads are higher; programs are declared, and vehicles know bends.
"""
STRIP_PERMISSIONS = {
    StripKind.LANE: {"disallow": "pedestrian"},
    StripKind.SIDEWALK: {"allow": "pedestrian"},
}
CLOSED_PERMISSION = {"disallow": "all"}


def write_sumo_network(road: Road, folder: Path) -> Path:
    """Write a road's SUMO network, `<road id>.net.xml`, and its source files.

    The same road gives the same bytes. The folder is created if it is missing.

    Raises:
        InputError: Streets or junctions do not fit together.
        RunError: `netconvert` is missing or fails.
    """
    folder.mkdir(parents=True, exist_ok=True)
    if isinstance(road.imported, MapNetwork):
        output = folder / f"{road.id}.net.xml"
        output.write_bytes(to_xml_bytes(unpack_network(road.imported.network)))
        return output
    plan = lay_out_road(road)
    documents = {
        "nodes": _build_nodes(plan),
        "edges": _build_edges(plan),
        "connections": _build_connections(plan),
        "tllogics": _build_signal_programs(plan),
    }
    for name, root in documents.items():
        (folder / f"{road.id}.{name}.xml").write_bytes(to_xml_bytes(root))
    return _compile_network(road.id, folder)


def _build_nodes(plan: RoadLayout) -> Element:
    root = Element("nodes")

    def add(name: str, position: Points, kind: str) -> Element:
        place = {axis: format_metres(value) for axis, value in zip("xyz", position, strict=True)}
        return SubElement(root, "node", {"id": name, "type": kind, **place})

    for junction in plan.junctions.values():
        outline = np.concatenate([corner.outer_edge for corner in junction.corners])
        centre = np.mean([arm.axis_end for arm in junction.arms], axis=0)
        add(junction.id, centre, _node_type(junction)).set("shape", format_shape(outline))
    for street in plan.streets.values():
        for name, point in ((street.begins, street.axis[0]), (street.ends, street.axis[-1])):
            if name not in plan.junctions:
                add(name, point, "dead_end")
    return root


def _node_type(junction: JunctionLayout) -> str:
    signed = {sign.street for sign in junction.declared.signs}
    everywhere = {path.movement.from_street for path in junction.connecting_paths} <= signed
    match junction.declared.control:
        case "signals":
            return "traffic_light"
        case "all_way_stop":
            return "allway_stop"
        case "stop":
            return "allway_stop" if everywhere else "priority_stop"
        case "yield":
            return "right_before_left" if everywhere else "priority"
        case "priority" | "none":
            return "priority"


def _build_edges(plan: RoadLayout) -> Element:
    root = Element("edges")
    for street in plan.streets.values():
        for along in (True, False):
            if strips := edge_strips(street, along=along):
                _add_edge(root, street, strips, plan, along=along)
    return root


def _add_edge(
    root: Element,
    street: StreetLayout,
    strips: tuple[StripLayout, ...],
    plan: RoadLayout,
    *,
    along: bool,
) -> None:
    begins, ends = (street.begins, street.ends) if along else (street.ends, street.begins)
    centres = [street.directed_line(strip.centre_t, along=along) for strip in strips]
    lengths_m = [polyline.polyline_length(centre) for centre in centres]
    driven = [
        length_m
        for strip, length_m in zip(strips, lengths_m, strict=True)
        if strip.kind is StripKind.LANE
    ]
    attributes = {
        "id": sumo_edge_id(street.id, along=along),
        "from": begins,
        "to": ends,
        "priority": str(_priority(street.id, plan.junctions.get(ends))),
        "speed": format_metres(street.speed_limit_m_s),
        "length": format_metres(float(np.mean(driven or lengths_m[:1]))),
        "numLanes": str(len(strips)),
        "spreadType": "right",
        "shape": format_shape(street.directed_line(strips[0].inner_t, along=along)),
    }
    edge = SubElement(root, "edge", attributes)
    # SUMO counts lanes from the right, strips are counted from the axis.
    pairs = zip(reversed(strips), reversed(centres), strict=True)
    for index, (strip, centre) in enumerate(pairs):
        shape = {"width": format_metres(strip.width_m), "shape": format_shape(centre)}
        permission = STRIP_PERMISSIONS.get(strip.kind, CLOSED_PERMISSION)
        SubElement(edge, "lane", {"index": str(index), **permission, **shape})


def _priority(street: str, junction: JunctionLayout | None) -> int:
    """Compute SUMO's priority: signed approaches give way, else wider streets go first."""
    if junction is None or any(sign.street == street for sign in junction.declared.signs):
        return 1
    arm = junction.find_arm(street)
    return 1 + sum(strip.kind is StripKind.LANE for strip in arm.inbound_strips())


def _build_connections(plan: RoadLayout) -> Element:
    root = Element("connections")
    for junction in plan.junctions.values():
        for path in junction.connecting_paths:
            link = _link_attributes(junction, path)
            SubElement(root, "connection", {**link, "shape": format_shape(path.centre)})
    for junction in plan.junctions.values():
        for index, crossing in enumerate(junction.crossings, start=len(junction.connecting_paths)):
            street = junction.find_arm(crossing.street).street
            edges = [
                sumo_edge_id(street.id, along=along)
                for along in (True, False)
                if edge_strips(street, along=along)
            ]
            attributes = {
                "node": junction.id,
                "edges": " ".join(edges),
                "width": format_metres(crossing.width_m),
                "priority": "true",
                "shape": format_shape(crossing.centre),
            }
            if junction.declared.control == "signals":
                attributes["linkIndex"] = str(index)
            SubElement(root, "crossing", attributes)
    return root


def _build_signal_programs(plan: RoadLayout) -> Element:
    root = Element("tlLogics")
    controlled = [item for item in plan.junctions.values() if item.declared.control == "signals"]
    for junction in controlled:
        if declared := junction.declared.signals:
            offset = format_metres(-declared.elapsed_s)
            attributes = {"id": junction.id, "type": "static", "programID": "0", "offset": offset}
            program = SubElement(root, "tlLogic", attributes)
            for duration_s, state in signals.build_signal_phases(junction, declared):
                phase = {"duration": format_metres(duration_s), "state": state}
                SubElement(program, "phase", phase)
    for junction in controlled:
        for index, path in enumerate(junction.connecting_paths):
            light = {"tl": junction.id, "linkIndex": str(index)}
            SubElement(root, "connection", {**_link_attributes(junction, path), **light})
    return root


def _link_attributes(junction: JunctionLayout, path: ConnectingPath) -> dict[str, str]:
    move = path.movement
    source, target = junction.find_arm(move.from_street), junction.find_arm(move.to_street)
    out, into = source.is_street_end, not target.is_street_end
    return {
        "from": sumo_edge_id(source.street.id, along=out),
        "to": sumo_edge_id(target.street.id, along=into),
        "fromLane": str(sumo_lane_index(source.street, move.from_lane, along=out)),
        "toLane": str(sumo_lane_index(target.street, move.to_lane, along=into)),
    }


def _compile_network(name: str, folder: Path) -> Path:
    output = folder / f"{name}.net.xml"
    outcome = run_netconvert(
        {
            "node-files": f"{name}.nodes.xml",
            "edge-files": f"{name}.edges.xml",
            "connection-files": f"{name}.connections.xml",
            "tllogic-files": f"{name}.tllogics.xml",
            "geometry.max-grade": str(MAX_GRADE_PERCENT),
            **{name: str(MAX_SPEED_M_S) for name in SPEED_WARNINGS},
        },
        output,
    )
    if not outcome.succeeded:
        raise RunError(f"road '{name}': netconvert fails: {outcome.messages}")
    if outcome.messages:
        raise InputError(
            f"road '{name}' gives a network that netconvert warns about: {outcome.messages}"
        )
    # The header holds a date and paths of this machine, but equal roads give equal bytes.
    text = output.read_text(encoding="utf-8")
    output.write_text(
        re.sub(r"<!-- generated on .*?-->\n*", "", text, flags=re.S), encoding="utf-8"
    )
    return output

"""The SUMO network of a road: plain XML from templates, compiled by SUMO's `netconvert`.

Network coordinates are world coordinates, heights included. Ids: the directed edges of a street
are `<street>+` along its axis and `<street>-` against it; junctions and traffic lights have the
declared junction's id. Every strip from the innermost driving lane outwards is a lane of its edge,
closed to traffic where it is neither a driving lane nor a sidewalk, so lateral positions hold.
"""

import os
import re
import subprocess
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import jinja2
import numpy as np
import sumo
from advercity_dsl import MapNetwork
from advercity_dsl.road import Road, StripKind

from advercity.errors import InputError, RunError
from advercity.geometry import polyline
from advercity.geometry.polyline import Points
from advercity.roads import signals
from advercity.roads.layout import JunctionLayout, RoadLayout, lay_out_road
from advercity.roads.streets import (
    StreetLayout,
    edge_strips,
    sumo_edge_id,
    sumo_lane_index,
)
from advercity.roads.sumo_xml import to_xml_bytes, unpack_network

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
    """Whether netconvert wrote the network, and what it printed."""

    succeeded: bool
    messages: str


def run_netconvert(options: Mapping[str, str], output: Path) -> NetconvertResult:
    """Run netconvert.

    Args:
        options: They override `NETCONVERT_OPTIONS`; files are relative to the folder of `output`.
        output: Path of the network to write.

    Raises:
        RunError: The program is missing or does not end in time.
    """
    chosen = {**NETCONVERT_OPTIONS, **options, "output-file": output.name}
    program = str(Path(sumo.SUMO_HOME) / "bin" / "netconvert")
    command = [program, *(word for name, value in chosen.items() for word in (f"--{name}", value))]
    try:
        done = subprocess.run(  # noqa: S603  the program is the wheel's own
            command,
            cwd=output.parent,
            env={**os.environ, "SUMO_HOME": sumo.SUMO_HOME},
            capture_output=True,
            text=True,
            errors="replace",  # messages quote names from maps, in whatever encoding
            timeout=NETCONVERT_TIMEOUT_S,
            check=False,
        )
    except (OSError, subprocess.TimeoutExpired) as error:
        raise RunError(f"netconvert does not run: {error}; is eclipse-sumo installed?") from error
    succeeded = done.returncode == 0 and output.exists()
    messages = done.stderr.strip()
    return NetconvertResult(succeeded, messages or ("" if succeeded else done.stdout.strip()))


MAX_GRADE_PERCENT = 30
"""netconvert warns of steeper edges, and a warning is an error here."""
STRIP_PERMISSIONS = {
    StripKind.LANE: 'disallow="pedestrian"',
    StripKind.SIDEWALK: 'allow="pedestrian"',
}
CLOSED_PERMISSION = 'disallow="all"'


Record = dict[str, Any]
"""Values of one element, by the names that the templates use."""


def write_sumo_network(road: Road, folder: Path) -> Path:
    """Write a road's SUMO network.

    Args:
        road: The declaration.
        folder: Folder for the plain XML files and `<road id>.net.xml`; created if missing.

    Returns:
        Path of the network; the same road gives the same bytes.

    Raises:
        InputError: Streets or junctions do not fit together.
        RunError: `netconvert` is missing or fails.
    """
    folder.mkdir(parents=True, exist_ok=True)
    if isinstance(road.imported, MapNetwork):
        return _write_imported_network(road.id, road.imported, folder)
    plan = lay_out_road(road)
    links = [link for junction in plan.junctions.values() for link in _build_links(junction)]
    contents = {
        "nodes": {"nodes": list(_build_nodes(plan))},
        "edges": {
            "edges": [edge for item in plan.streets.values() for edge in _build_edges(item, plan)]
        },
        "connections": {
            "links": links,
            "crossings": [item for j in plan.junctions.values() for item in _build_crossings(j)],
        },
        "tllogics": {
            "programs": [
                p for j in plan.junctions.values() if (p := signals.build_signal_program(j))
            ],
            "links": links,
        },
    }
    for name, values in contents.items():
        text = _load_templates().get_template(f"{name}.xml.j2").render(values)
        (folder / f"{road.id}.{name}.xml").write_text(text, encoding="utf-8")
    return _compile_network(road.id, folder)


def _write_imported_network(name: str, imported: MapNetwork, folder: Path) -> Path:
    output = folder / f"{name}.net.xml"
    output.write_bytes(to_xml_bytes(unpack_network(imported.network)))
    return output


def _build_nodes(plan: RoadLayout) -> Iterator[Record]:
    for junction in plan.junctions.values():
        centre = np.mean([arm.axis_end for arm in junction.arms], axis=0)
        outline = np.concatenate([corner.outer_edge for corner in junction.corners])
        yield {
            "id": junction.id,
            "position": centre,
            "type": _node_type(junction),
            "outline": outline,
        }
    for street in plan.streets.values():
        for name, point in ((street.begins, street.axis[0]), (street.ends, street.axis[-1])):
            if name not in plan.junctions:
                yield {"id": name, "position": point, "type": "dead_end", "outline": None}


def _node_type(junction: JunctionLayout) -> str:
    signed = {sign.street for sign in junction.declared.signs}
    everywhere = {path.movement.from_street for path in junction.connecting_paths} <= signed
    match junction.declared.control:
        case "signals":
            return "traffic_light"
        case "stop":
            return "allway_stop" if everywhere else "priority_stop"
        case "yield":
            return "right_before_left" if everywhere else "priority"
        case "priority" | "none":
            return "priority"


def _build_edges(street: StreetLayout, plan: RoadLayout) -> Iterator[Record]:
    for along in (True, False):
        strips = edge_strips(street, along=along)
        if not strips:
            continue
        begins, ends = (street.begins, street.ends) if along else (street.ends, street.begins)
        centres = [street.directed_line(strip.centre_t, along=along) for strip in strips]
        driven = [
            polyline.polyline_length(centre)
            for strip, centre in zip(strips, centres, strict=True)
            if strip.kind is StripKind.LANE
        ]
        yield {
            "id": sumo_edge_id(street.id, along=along),
            "begins": begins,
            "ends": ends,
            "priority": _priority(street.id, plan.junctions.get(ends)),
            "speed_m_s": street.speed_limit_m_s,
            "length_m": float(np.mean(driven or [polyline.polyline_length(centres[0])])),
            "border": street.directed_line(strips[0].inner_t, along=along),
            "lanes": tuple(
                {
                    "width_m": strip.width_m,
                    "permission": STRIP_PERMISSIONS.get(strip.kind, CLOSED_PERMISSION),
                    "centre": centre,
                }
                for strip, centre in zip(reversed(strips), reversed(centres), strict=True)
            ),
        }


def _priority(street: str, junction: JunctionLayout | None) -> int:
    """Compute SUMO's priority: signed approaches give way, else wider streets go first."""
    if junction is None or any(sign.street == street for sign in junction.declared.signs):
        return 1
    arm = junction.find_arm(street)
    return 1 + sum(strip.kind is StripKind.LANE for strip in arm.inbound_strips())


def _build_links(junction: JunctionLayout) -> Iterator[Record]:
    signalled = junction.declared.control == "signals"
    for index, path in enumerate(junction.connecting_paths):
        source = junction.find_arm(path.movement.from_street)
        target = junction.find_arm(path.movement.to_street)
        yield {
            "junction": junction.id,
            "from_edge": sumo_edge_id(source.street.id, along=source.is_street_end),
            "to_edge": sumo_edge_id(target.street.id, along=not target.is_street_end),
            "from_lane": sumo_lane_index(
                source.street, path.movement.from_lane, along=source.is_street_end
            ),
            "to_lane": sumo_lane_index(
                target.street, path.movement.to_lane, along=not target.is_street_end
            ),
            "centre": path.centre,
            "index": index if signalled else None,
        }


def _build_crossings(junction: JunctionLayout) -> Iterator[Record]:
    signalled = junction.declared.control == "signals"
    for index, crossing in enumerate(junction.crossings, start=len(junction.connecting_paths)):
        street = junction.find_arm(crossing.street).street
        yield {
            "junction": junction.id,
            "edges": tuple(
                sumo_edge_id(street.id, along=along)
                for along in (True, False)
                if edge_strips(street, along=along)
            ),
            "width_m": crossing.width_m,
            "centre": crossing.centre,
            "index": index if signalled else None,
        }


def _load_templates() -> jinja2.Environment:
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("advercity.roads"),
        undefined=jinja2.StrictUndefined,
        autoescape=False,  # noqa: S701  names are `Id`s; permissions hold quotes
        keep_trailing_newline=True,
    )
    environment.filters["metres"] = _format_metres
    environment.filters["shape"] = _format_shape
    return environment


def _format_metres(value: float) -> str:
    return f"{round(float(value), 3) + 0.0:.3f}"


def _format_shape(points: Points) -> str:
    return " ".join(",".join(_format_metres(value) for value in point) for point in points)


def _compile_network(name: str, folder: Path) -> Path:
    output = folder / f"{name}.net.xml"
    outcome = run_netconvert(
        {
            "node-files": f"{name}.nodes.xml",
            "edge-files": f"{name}.edges.xml",
            "connection-files": f"{name}.connections.xml",
            "tllogic-files": f"{name}.tllogics.xml",
            "geometry.max-grade": str(MAX_GRADE_PERCENT),
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

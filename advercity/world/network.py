"""The SUMO network of a road: plain XML from templates, compiled by `netconvert`.

Network coordinates are world coordinates, heights included. Ids: the directed edges of a street
are `<street>+` along its axis and `<street>-` against it; junctions and traffic lights have the
declared junction's id. Every strip from the innermost driving lane outwards is a lane of its edge,
closed to traffic where it is neither a driving lane nor a sidewalk, so lateral positions hold.
"""

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree

import jinja2
import numpy as np
from advercity_dsl import MapNetwork
from advercity_dsl.road import Road, StripKind

from advercity import curves
from advercity.curves import Points
from advercity.errors import InputError, RunError
from advercity.netconvert import netconvert
from advercity.networks import unpacked
from advercity.streets import StreetLayout
from advercity.world import signals
from advercity.world.edges import approach, edge_bands, edge_id, lane_id, lane_index, street_of
from advercity.world.junctions import JunctionLayout
from advercity.world.layout import Layout, layout
from advercity.xml_input import written

__all__ = [
    "build_network",
    "edge_id",
    "lane_id",
    "lane_index",
    "signal_groups",
    "street_of",
]

STEEPEST_PERCENT = 30
PERMISSIONS = {StripKind.LANE: 'disallow="pedestrian"', StripKind.SIDEWALK: 'allow="pedestrian"'}
CLOSED = 'disallow="all"'


@dataclass(frozen=True)
class _Node:
    id: str
    position: Points
    type: str
    outline: Points | None


@dataclass(frozen=True)
class _Lane:
    width_m: float
    permission: str
    centre: Points


@dataclass(frozen=True)
class _Edge:
    id: str
    begins: str
    ends: str
    priority: int
    speed_m_s: float
    length_m: float
    border: Points
    lanes: tuple[_Lane, ...]


@dataclass(frozen=True)
class _Link:
    junction: str
    from_edge: str
    to_edge: str
    from_lane: int
    to_lane: int
    centre: Points
    index: int | None


@dataclass(frozen=True)
class _Crossing:
    junction: str
    edges: tuple[str, ...]
    width_m: float
    centre: Points
    index: int | None


def build_network(road: Road, folder: Path) -> Path:
    """Write a road's SUMO network.

    Args:
        road: What to build.
        folder: Gets the plain XML files and `<road id>.net.xml`; made if missing.

    Returns:
        Path of the network; the same road gives the same bytes.

    Raises:
        InputError: Streets or junctions do not fit together.
        RunError: `netconvert` is missing or fails.
    """
    folder.mkdir(parents=True, exist_ok=True)
    if isinstance(road.imported, MapNetwork):
        return _unpack(road.id, road.imported, folder)
    plan = layout(road)
    links = [link for junction in plan.junctions.values() for link in _links(junction)]
    contents = {
        "nodes": {"nodes": list(_nodes(plan))},
        "edges": {"edges": [edge for item in plan.streets.values() for edge in _edges(item, plan)]},
        "connections": {
            "links": links,
            "crossings": [item for j in plan.junctions.values() for item in _crossings(j)],
        },
        "tllogics": {
            "programs": [p for j in plan.junctions.values() if (p := signals.program(j))],
            "links": links,
        },
    }
    for name, values in contents.items():
        text = _templates().get_template(f"{name}.xml.j2").render(values)
        (folder / f"{road.id}.{name}.xml").write_text(text, encoding="utf-8")
    return _netconvert(road.id, folder)


def _unpack(name: str, imported: MapNetwork, folder: Path) -> Path:
    output = folder / f"{name}.net.xml"
    output.write_bytes(written(unpacked(imported.network)))
    return output


def signal_groups(network: Path) -> dict[str, list[tuple[str, int]]]:
    """Links that show the light of an approach.

    Args:
        network: Path of a network from `build_network`.

    Returns:
        By `<light>/<approach>`, an approach being a street or an imported edge: (traffic-light
        id, index into its state) of every movement.
    """
    lights: dict[str, list[tuple[str, int]]] = {}
    for link in ElementTree.parse(network).iter("connection"):  # noqa: S314 - from netconvert
        source, on_foot = link.attrib["from"], link.attrib["to"].startswith(":")
        if "tl" in link.attrib and not (on_foot or source.startswith(":")):
            found = lights.setdefault(link.attrib["tl"], [])
            found.append((approach(source), int(link.attrib["linkIndex"])))
    groups: dict[str, list[tuple[str, int]]] = {}
    for light, links in lights.items():
        for side, index in links:
            groups.setdefault(f"{light}/{side}", []).append((light, index))
    return {name: sorted(links) for name, links in groups.items()}


def _nodes(plan: Layout) -> Iterator[_Node]:
    for junction in plan.junctions.values():
        centre = np.mean([arm.point for arm in junction.arms], axis=0)
        rim = np.concatenate([corner.rim for corner in junction.corners])
        yield _Node(junction.id, centre, _node_type(junction), rim)
    for street in plan.streets.values():
        for name, point in ((street.begins, street.axis[0]), (street.ends, street.axis[-1])):
            if name not in plan.junctions:
                yield _Node(name, point, "dead_end", None)


def _node_type(junction: JunctionLayout) -> str:
    signed = {sign.street for sign in junction.declared.signs}
    everywhere = {path.movement.from_street for path in junction.paths} <= signed
    match junction.declared.control:
        case "signals":
            return "traffic_light"
        case "stop":
            return "allway_stop" if everywhere else "priority_stop"
        case "yield":
            return "right_before_left" if everywhere else "priority"
        case "priority" | "none":
            return "priority"


def _edges(street: StreetLayout, plan: Layout) -> Iterator[_Edge]:
    for along in (True, False):
        bands = edge_bands(street, along=along)
        if not bands:
            continue
        begins, ends = (street.begins, street.ends) if along else (street.ends, street.begins)
        centres = [street.travelled(band.centre_t, along=along) for band in bands]
        driven = [
            curves.length(centre)
            for band, centre in zip(bands, centres, strict=True)
            if band.kind is StripKind.LANE
        ]
        yield _Edge(
            id=edge_id(street.id, along=along),
            begins=begins,
            ends=ends,
            priority=_priority(street.id, plan.junctions.get(ends)),
            speed_m_s=street.speed_limit_m_s,
            length_m=float(np.mean(driven or [curves.length(centres[0])])),
            border=street.travelled(bands[0].inner_t, along=along),
            lanes=tuple(
                _Lane(band.width_m, PERMISSIONS.get(band.kind, CLOSED), centre)
                for band, centre in zip(reversed(bands), reversed(centres), strict=True)
            ),
        )


def _priority(street: str, junction: JunctionLayout | None) -> int:
    """Signed approaches give way; elsewhere the wider street goes first."""
    if junction is None or any(sign.street == street for sign in junction.declared.signs):
        return 1
    arm = junction.arm(street)
    return 1 + sum(band.kind is StripKind.LANE for band in arm.arriving())


def _links(junction: JunctionLayout) -> Iterator[_Link]:
    signalled = junction.declared.control == "signals"
    for index, path in enumerate(junction.paths):
        source = junction.arm(path.movement.from_street)
        target = junction.arm(path.movement.to_street)
        yield _Link(
            junction=junction.id,
            from_edge=edge_id(source.street.id, along=source.at_end),
            to_edge=edge_id(target.street.id, along=not target.at_end),
            from_lane=lane_index(source.street, path.movement.from_lane, along=source.at_end),
            to_lane=lane_index(target.street, path.movement.to_lane, along=not target.at_end),
            centre=path.centre,
            index=index if signalled else None,
        )


def _crossings(junction: JunctionLayout) -> Iterator[_Crossing]:
    signalled = junction.declared.control == "signals"
    for index, crossing in enumerate(junction.crossings, start=len(junction.paths)):
        street = junction.arm(crossing.street).street
        yield _Crossing(
            junction=junction.id,
            edges=tuple(
                edge_id(street.id, along=along)
                for along in (True, False)
                if edge_bands(street, along=along)
            ),
            width_m=crossing.width_m,
            centre=crossing.centre,
            index=index if signalled else None,
        )


def _templates() -> jinja2.Environment:
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("advercity.world"),
        undefined=jinja2.StrictUndefined,
        autoescape=False,  # noqa: S701  names are `Id`s; permissions hold quotes
        keep_trailing_newline=True,
    )
    environment.filters["metres"] = _metres
    environment.filters["shape"] = _shape
    return environment


def _metres(value: float) -> str:
    return f"{round(float(value), 3) + 0.0:.3f}"


def _shape(points: Points) -> str:
    return " ".join(",".join(_metres(value) for value in point) for point in points)


def _netconvert(name: str, folder: Path) -> Path:
    output = folder / f"{name}.net.xml"
    outcome = netconvert(
        {
            "node-files": f"{name}.nodes.xml",
            "edge-files": f"{name}.edges.xml",
            "connection-files": f"{name}.connections.xml",
            "tllogic-files": f"{name}.tllogics.xml",
            "geometry.max-grade": str(STEEPEST_PERCENT),
        },
        output,
    )
    if not outcome.succeeded:
        raise RunError(f"road '{name}': netconvert fails: {outcome.said}")
    if outcome.said:
        raise InputError(f"road '{name}' makes no clean network: {outcome.said}")
    text = output.read_text(encoding="utf-8")
    output.write_text(
        re.sub(r"<!-- generated on .*?-->\n*", "", text, flags=re.S), encoding="utf-8"
    )
    return output

"""Lanelet2 documents: points, lines and relations of OpenStreetMap's XML, with all references.

The format: lanelet2_maps/README.md and lanelet2_core/doc of github.com/fzi-forschungszentrum-
informatik/Lanelet2.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from xml.etree.ElementTree import Element

from advercity.errors import InputError
from advercity.foreign.xml_documents import get_line
from advercity.roads.osm_map import Tags, list_nodes, read_tags

MAX_LANELETS = 20_000
"""Most lanelets of a map; more would take hours to compare with each other."""


@dataclass(frozen=True, eq=False)
class Way:
    """A line through nodes."""

    id: str
    nodes: tuple[str, ...]
    tags: Tags
    line: int


@dataclass(frozen=True)
class Member:
    """An element of a relation, and its role."""

    kind: str
    ref: str
    role: str


@dataclass(frozen=True, eq=False)
class Relation:
    """A lanelet, an area or a regulatory element."""

    id: str
    members: tuple[Member, ...]
    tags: Tags
    line: int

    def list_members(self, role: str, kind: str) -> list[str]:
        """List the ids of the members with a role."""
        return [item.ref for item in self.members if (item.role, item.kind) == (role, kind)]


@dataclass(frozen=True, eq=False)
class LaneletDocument:
    """A map as its file has it.

    Attributes:
        nodes: Nodes by id.
        ways: Ways by id.
        lanelets: Lanelets by id.
        rules: Regulatory elements by id.
    """

    nodes: Mapping[str, Element]
    ways: Mapping[str, Way]
    lanelets: Mapping[str, Relation]
    rules: Mapping[str, Relation]


def parse_document(root: Element) -> LaneletDocument:
    """Parse a document.

    Raises:
        InputError: It has too many lanelets, or a lanelet refers to a missing element.
    """
    relations = {item.get("id", ""): _parse_relation(item) for item in root.iter("relation")}
    document = LaneletDocument(
        nodes={item.get("id", ""): item for item in root.iter("node")},
        ways={item.get("id", ""): _parse_way(item) for item in root.iter("way")},
        lanelets=_select(relations, "lanelet"),
        rules=_select(relations, "regulatory_element"),
    )
    if len(document.lanelets) > MAX_LANELETS:
        raise InputError(f"has {len(document.lanelets)} lanelets; at most {MAX_LANELETS} are read")
    for lanelet in document.lanelets.values():
        for side in ("left", "right"):
            _check_bound(document, lanelet, side)
    return document


def join_ways(ways: Sequence[Way]) -> tuple[str, ...] | None:
    """Join ways in a row to one line through nodes, whichever way they point; None if they gape."""
    lines = [way.nodes for way in ways]
    joined = lines[0]
    if len(lines) > 1 and joined[0] in (lines[1][0], lines[1][-1]):
        joined = joined[::-1]
    for line in lines[1:]:
        following = line if line[0] == joined[-1] else line[::-1]
        if following[0] != joined[-1]:
            return None
        joined += following[1:]
    return joined


def fault(at: Way | Relation, message: str) -> InputError:
    """Make the error of a way or relation."""
    kind = "way" if isinstance(at, Way) else "relation"
    return InputError(f"line {at.line}: {kind} {at.id[:40]}: {message}")


def _select(relations: Mapping[str, Relation], kind: str) -> dict[str, Relation]:
    return {name: item for name, item in relations.items() if item.tags.get("type") == kind}


def _parse_way(item: Element) -> Way:
    # A repeated node has no direction.
    nodes = list(_drop_repeated(list_nodes(item)))
    return Way(item.get("id", ""), tuple(nodes), read_tags(item), get_line(item))


def _drop_repeated(nodes: Sequence[str]) -> Iterator[str]:
    for index, node in enumerate(nodes):
        if index == 0 or nodes[index - 1] != node:
            yield node


def _parse_relation(item: Element) -> Relation:
    members = tuple(
        Member(it.get("type", ""), it.get("ref", ""), it.get("role", ""))
        for it in item.iter("member")
    )
    return Relation(item.get("id", ""), members, read_tags(item), get_line(item))


def _check_bound(document: LaneletDocument, lanelet: Relation, side: str) -> None:
    refs = lanelet.list_members(side, "way")
    if not refs:
        raise fault(lanelet, f"a lanelet without a {side} bound; give it a way as `{side}`")
    for ref in refs:
        way = document.ways.get(ref)
        if way is None:
            raise fault(lanelet, f"its {side} bound is way {ref[:40]}, which the file lacks")
        if len(way.nodes) < 2:
            raise fault(way, f"the {side} bound of lanelet {lanelet.id[:40]} has one point only")
        missing = next((node for node in way.nodes if node not in document.nodes), None)
        if missing is not None:
            raise fault(way, f"goes through node {missing[:40]}, which the file lacks")
    if join_ways([document.ways[ref] for ref in refs]) is None:
        raise fault(lanelet, f"the ways of its {side} bound do not follow each other")

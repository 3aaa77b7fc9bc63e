"""Omitted parts of a Lanelet2 map."""

from collections.abc import Iterable, Iterator, Mapping
from itertools import pairwise
from xml.etree.ElementTree import Element

from advercity.foreign.ledger import Ledger
from advercity.foreign.standards import apply_disposition, load_standard
from advercity.roads.lanelet2.document import LaneletDocument, Way
from advercity.roads.lanelet2.lanelets import Lanelet
from advercity.roads.lanelet2.network import LaneletTopology
from advercity.roads.lanelet2.rules import Approach
from advercity.roads.osm_map import read_tags

RELATION_KINDS: Mapping[str, str] = {
    "lanelet": "lanelet",
    "multipolygon": "area",
    "area": "area",
    "regulatory_element": "rule",
}
"""Rows of the table by the type of a relation."""


def record_omissions(root: Element, ledger: Ledger) -> None:
    """Record the omitted parts of a map; InputError if a part is refused."""
    standard = load_standard("lanelet2")
    standard.audit(root, ledger)
    for kind in ("node", "way"):
        for item in root.iter(kind):
            standard.audit_tags(item, f"{kind} tags", ledger)
    for item in root.iter("relation"):
        kind = RELATION_KINDS.get(read_tags(item).get("type", ""))
        standard.audit_tags(item, f"{kind or 'relation'} tags", ledger)
        roles = standard.elements.get(f"{kind} roles", {})
        for member in item.iter("member") if kind else ():
            role = member.get("role", "")
            unknown = f"left out: member as {role[:40]!r} | members as {role[:40]!r}"
            apply_disposition(roles.get(role, unknown), "", member, ledger)


def record_unused(
    document: LaneletDocument,
    topology: LaneletTopology,
    lanelets: Iterable[Lanelet],
    ledger: Ledger,
) -> None:
    """Record unused lanelets, and lines against lane changes, which do not prevent them."""
    for item in topology.list_unused():
        name = "lanelet in a junction that leads nowhere (paved, not driven)"
        plural = "lanelets in junctions that lead nowhere (paved, not driven)"
        ledger.leave_out(name, plural=plural, at=document.lanelets[item.id].line)
    for item in topology.list_apart(lanelets):
        name = "lanelet apart from streets (paved, not used)"
        plural = "lanelets apart from streets (paved, not used)"
        ledger.leave_out(name, plural=plural, at=document.lanelets[item.id].line)
    for way in dict.fromkeys(_list_barriers(document, topology)):
        name = "line that forbids to change lanes (lanes are changed all the same)"
        plural = "lines that forbid to change lanes (lanes are changed all the same)"
        ledger.leave_out(name, plural=plural, at=way.line)


def record_rules(
    document: LaneletDocument,
    topology: LaneletTopology,
    approaches: Mapping[str, Approach],
    ledger: Ledger,
) -> None:
    """Record stop signs without a junction, and lights missing at some approaches."""
    groups = topology.map.groups
    nodes = {name: groups.find(street.ends) for name, street in topology.map.streets.items()}
    lit = {nodes[name] for name, approach in approaches.items() if approach.has_light}
    for name, approach in approaches.items():
        line = document.lanelets[topology.map.streets[name].first_lanelets[0].id].line
        if nodes[name] not in topology.crossed:
            if approach.must_stop:
                what = "street with a stop sign where no ways cross"
                plural = "streets with stop signs where no ways cross"
                ledger.leave_out(what, plural=plural, at=line)
        elif nodes[name] in lit and not approach.has_light:
            what = "light that the map lacks at an approach of a signalised junction (assumed)"
            plural = "lights that the map lacks at approaches of signalised junctions (assumed)"
            ledger.leave_out(what, plural=plural, at=line)


def _list_barriers(document: LaneletDocument, topology: LaneletTopology) -> Iterator[Way]:
    """List the ways between lanes of one direction without lane changes in both senses."""
    for section in topology.graph.sections:
        for left, right in pairwise(section.lanelets):
            if not (left.is_driven and right.is_driven):
                continue
            ways = (
                {ref for side in ("left", "right") for ref in relation.list_members(side, "way")}
                for relation in (document.lanelets[left.id], document.lanelets[right.id])
            )
            shared = set.intersection(*ways)
            yield from (way for ref in sorted(shared) if not _may_cross(way := document.ways[ref]))


def _may_cross(way: Way) -> bool:
    usual = "yes" if way.tags.get("subtype") == "dashed" else "no"
    return way.tags.get("lane_change", usual) == "yes"

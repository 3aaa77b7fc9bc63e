"""Parts of a Lanelet2 map that are not taken over."""

from collections.abc import Mapping
from xml.etree.ElementTree import Element

from advercity.foreign.ledger import Ledger
from advercity.foreign.standards import apply_disposition, load_standard
from advercity.roads.osm_map import read_tags

RELATION_KINDS: Mapping[str, str] = {
    "lanelet": "lanelet",
    "multipolygon": "area",
    "area": "area",
    "regulatory_element": "rule",
}
"""Rows of the table by the type of a relation."""


def record_omissions(root: Element, ledger: Ledger) -> None:
    """Record what of a map is left out; InputError where a part of it is refused."""
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

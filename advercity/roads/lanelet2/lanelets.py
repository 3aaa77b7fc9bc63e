"""Lanelets with bounds in their direction of travel."""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import shapely
from advercity_dsl.road.extent import MAX_SITE_M
from shapely.geometry.base import BaseGeometry

from advercity.foreign.ledger import Ledger
from advercity.geometry.polyline import Points, polyline_length
from advercity.roads.lane_uses import LaneUse
from advercity.roads.lanelet2.document import LaneletDocument, Relation, fault, join_ways
from advercity.roads.lanelet2.uses import find_use, find_usual_limit_m_s, parse_limit_m_s
from advercity.roads.network_file import build_enclosed_area


@dataclass(frozen=True, eq=False)
class Bound:
    """A border: ids of its nodes, and their places (n, 3)."""

    nodes: tuple[str, ...]
    points: Points

    @property
    def reverse(self) -> "Bound":
        """The same border in the other direction."""
        return Bound(self.nodes[::-1], self.points[::-1])


@dataclass(frozen=True, eq=False)
class Lanelet:
    """A lanelet; its bounds point in the direction of travel.

    Attributes:
        id: Its id in the map.
        name: Name of its street; empty if the map has none.
        use: Who may use it.
        speed_m_s: Its limit.
        left: Left bound.
        right: Right bound.
        rules: Ids of its regulatory elements.
        is_two_way: Whether vehicles use it in both directions.
    """

    id: str
    name: str
    use: LaneUse
    speed_m_s: float
    left: Bound
    right: Bound
    rules: frozenset[str]
    is_two_way: bool

    @property
    def begins(self) -> tuple[str, str]:
        """Ids of its first nodes, left and right."""
        return self.left.nodes[0], self.right.nodes[0]

    @property
    def ends(self) -> tuple[str, str]:
        """Ids of its last nodes, left and right."""
        return self.left.nodes[-1], self.right.nodes[-1]

    @property
    def is_driven(self) -> bool:
        """Whether motor vehicles drive on it."""
        return not (self.use.is_walked or self.use.is_closed or "bicycle" in self.use.permission[1])

    @cached_property
    def area(self) -> BaseGeometry:
        """The area between its bounds."""
        return build_enclosed_area(np.vstack([self.left.points, self.right.points[::-1]]))

    @property
    def reverse(self) -> "Lanelet":
        """The lanelet of the traffic in the other direction."""
        return replace(self, left=self.right.reverse, right=self.left.reverse)

    @property
    def mirror(self) -> "Lanelet":
        """Its mirror image at the x axis, which exchanges left and right."""
        return replace(self, left=_mirror(self.right), right=_mirror(self.left))


def read_lanelets(
    document: LaneletDocument, points: Mapping[str, Points], ledger: Ledger
) -> tuple[Lanelet, ...]:
    """Read the lanes of a map; lanelets in both directions are two."""
    found = (_read_lanelet(document, item, points, ledger) for item in document.lanelets.values())
    lanelets = [item for item in found if item is not None]
    return tuple(
        it
        for item in lanelets
        for it in ((item, item.reverse) if item.is_two_way and item.is_driven else (item,))
    )


def list_crosswalks(document: LaneletDocument, points: Mapping[str, Points]) -> Iterator[Points]:
    """List the middles (3,) of the crosswalks of a map."""
    for item in document.lanelets.values():
        if item.tags.get("subtype") == "crosswalk":
            bounds = (_read_bound(document, item, side, points) for side in ("left", "right"))
            yield np.mean([bound.points.mean(axis=0) for bound in bounds], axis=0)


def has_left_hand_traffic(lanelets: Iterable[Lanelet]) -> bool | None:
    """Whether opposite lanelets have their common bound on their right; None if none has one."""
    sides = {bound.nodes: side for item in lanelets for side, bound in _list_sides(item)}
    found = [
        side == "right"
        for item in lanelets
        for side, bound in _list_sides(item)
        if sides.get(bound.nodes[::-1]) == side
    ]
    return None if not found else sum(found) * 2 > len(found)


def _list_sides(item: Lanelet) -> tuple[tuple[str, Bound], ...]:
    if item.is_two_way or not item.is_driven:
        return ()
    return ("left", item.left), ("right", item.right)


def _read_lanelet(
    document: LaneletDocument, item: Relation, points: Mapping[str, Points], ledger: Ledger
) -> Lanelet | None:
    use = find_use(item.tags)
    left, right = (_read_bound(document, item, side, points) for side in ("left", "right"))
    rules = frozenset(item.list_members("regulatory_element", "relation"))
    if use is None:
        return None
    if max(polyline_length(bound.points) for bound in (left, right)) > MAX_SITE_M:
        raise fault(item, f"a lanelet that is longer than {MAX_SITE_M:g} m")
    turned = _orient(left, right)
    if turned is None:
        ledger.leave_out("lanelet without width", plural="lanelets without width", at=item.line)
        return None
    return Lanelet(
        id=item.id,
        name=item.tags.get("road_name", ""),
        use=use,
        speed_m_s=_find_limit(document, item, rules, ledger)
        or find_usual_limit_m_s(item.tags, use),
        left=turned[0],
        right=turned[1],
        rules=rules,
        is_two_way=item.tags.get("one_way", "yes") in ("no", "false"),
    )


def _read_bound(
    document: LaneletDocument, item: Relation, side: str, points: Mapping[str, Points]
) -> Bound:
    ways = [document.ways[ref] for ref in item.list_members(side, "way")]
    nodes = join_ways(ways) or ()
    return Bound(nodes, np.array([points[node] for node in nodes]))


def _orient(left: Bound, right: Bound) -> tuple[Bound, Bound] | None:
    """Turn bounds into the direction in which the left one is on the left; None if they are one."""
    first, second = left.points[:, :2], right.points[:, :2]
    rings = [shapely.Polygon(np.vstack([first, other])) for other in (second[::-1], second)]
    # If both bounds have the same direction, the ring between them does not cross itself.
    valid = [ring.is_valid for ring in rings]
    if valid[0] == valid[1]:
        apart = [
            np.linalg.norm(first[[0, -1]] - other[[0, -1]], axis=1).sum()
            for other in (second, second[::-1])
        ]
        valid[1] = bool(apart[1] < apart[0])
        valid[0] = not valid[1]
    ring = rings[0] if valid[0] else rings[1]
    if not ring.area > 0:
        return None
    # Along the left bound, and back along the right one, is clockwise.
    if ring.exterior.is_ccw:
        return left.reverse, right.reverse if valid[0] else right
    return left, right if valid[0] else right.reverse


def _find_limit(
    document: LaneletDocument, item: Relation, rules: Iterable[str], ledger: Ledger
) -> float | None:
    """Find the map's limit for a lanelet: of its own tag, else of its signs."""
    own = item.tags.get("speed_limit")
    texts = [own] if own is not None else []
    for name in sorted(rules):
        rule = document.rules.get(name)
        if rule is None or rule.tags.get("subtype") != "speed_limit":
            continue
        signs = [
            document.ways[ref].tags
            for ref in rule.list_members("refers", "way")
            if ref in document.ways
        ]
        texts += [sign.get("subtype", "") for sign in signs]
        texts += [rule.tags["sign_type"]] if "sign_type" in rule.tags else []
    limits = [limit for text in texts if (limit := parse_limit_m_s(text)) is not None]
    if texts and not limits:
        ledger.leave_out(
            "speed limit that is no number", plural="speed limits that are no numbers", at=item.line
        )
    return min(limits) if limits else None


def _mirror(bound: Bound) -> Bound:
    return Bound(bound.nodes, bound.points * (1.0, -1.0, 1.0))

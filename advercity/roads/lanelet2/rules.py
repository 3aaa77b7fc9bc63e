"""Right of way and lights at the ends of streets, by regulatory elements."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass

from advercity.roads.lanelet2.document import LaneletDocument, Relation
from advercity.roads.lanelet2.lanelets import Lanelet

STOP_SIGNS = frozenset(("de206", "usR1-1", "stop_sign"))
YIELD_SIGNS = frozenset(("de205", "usR1-2"))
"""Subtypes of signs in Lanelet2's and Autoware's maps."""
YIELDS, USUAL, HAS_RIGHT_OF_WAY = 0, 1, 2
"""Priorities of streets; netconvert makes streets of 0 stop if a node has stop signs."""


@dataclass(frozen=True)
class Approach:
    """Rules at the end of a street."""

    priority: int = USUAL
    must_stop: bool = False
    has_light: bool = False


class RightOfWay:
    """Finds the rules of approaches."""

    def __init__(self, document: LaneletDocument) -> None:
        self._rules = {name: _Rule.read(item, document) for name, item in document.rules.items()}

    def find(self, before: Iterable[Lanelet], ways: Sequence[Sequence[Lanelet]]) -> Approach:
        """Find the rules at the end of a street.

        Args:
            before: Lanelets before the end.
            ways: Lanelets of every way through the junction behind it. A rule for some of them
                only, as for left turns, is left to the usual ones.
        """
        own = self._list_rules(before)
        behind = [self._list_rules(way) for way in ways] or [[]]

        def holds(test: Callable[[str, "_Rule"], bool]) -> bool:
            everywhere = all(any(test(*pair) for pair in way) for way in behind)
            return everywhere or any(test(*pair) for pair in own)

        yields = holds(lambda lanelet, rule: rule.is_yielding(lanelet))
        has_right = holds(lambda lanelet, rule: lanelet in rule.has_right_of_way)
        return Approach(
            YIELDS if yields else HAS_RIGHT_OF_WAY if has_right else USUAL,
            must_stop=holds(lambda lanelet, rule: rule.stops and rule.is_yielding(lanelet)),
            has_light=holds(lambda _, rule: rule.is_light),
        )

    def _list_rules(self, lanelets: Iterable[Lanelet]) -> list[tuple[str, "_Rule"]]:
        return [
            (lanelet.id, rule)
            for lanelet in lanelets
            for name in lanelet.rules
            if (rule := self._rules.get(name)) is not None
        ]


@dataclass(frozen=True)
class _Rule:
    """A regulatory element: ids of lanelets with the duty to yield, and with right of way."""

    yielding: frozenset[str]
    has_right_of_way: frozenset[str]
    stops: bool
    is_light: bool
    is_sign: bool

    @staticmethod
    def read(item: Relation, document: LaneletDocument) -> "_Rule":
        kind = item.tags.get("subtype", "")
        signs = {
            document.ways[ref].tags.get("subtype", "")
            for ref in item.list_members("refers", "way")
            if ref in document.ways
        }
        return _Rule(
            yielding=frozenset(item.list_members("yield", "relation")),
            has_right_of_way=frozenset(item.list_members("right_of_way", "relation")),
            stops=kind == "all_way_stop" or bool(signs & STOP_SIGNS),
            is_light=kind == "traffic_light",
            is_sign=kind == "traffic_sign" and bool(signs & (STOP_SIGNS | YIELD_SIGNS)),
        )

    def is_yielding(self, lanelet: str) -> bool:
        return self.is_sign or lanelet in self.yielding


def find_node_type(approaches: Mapping[str, Approach]) -> str:
    """Find SUMO's type of the node at the end of approaches."""
    found = list(approaches.values())
    if any(item.has_light for item in found):
        return "traffic_light"
    if found and all(item.must_stop for item in found):
        return "allway_stop"
    return "priority_stop" if any(item.must_stop for item in found) else "priority"

"""Lanelet2 documents that tests write, and the roads that are imported from them."""

from collections.abc import Sequence
from pathlib import Path

from advercity_dsl import MapFile, MapNetwork, Road

from advercity.roads.map_import import import_map
from advercity.roads.network_file import SumoEdge, SumoNetwork, parse_packed_network
from tests.roads.imported_roads import declaration

Point = tuple[float, ...]


class LaneletMap:
    """A map in local coordinates; points at one place are one node."""

    def __init__(self) -> None:
        self._nodes: dict[Point, int] = {}
        self._parts: list[str] = []
        self._id = 1000

    def way(self, points: Sequence[Point], kind: str = "line_thin", **tags: str) -> int:
        nodes = [self._nodes.setdefault(point, len(self._nodes) + 1) for point in points]
        refs = "".join(f'<nd ref="{node}"/>' for node in nodes)
        return self._add("way", refs, {"type": kind, **tags})

    def lanelet(self, left: int, right: int, rules: Sequence[int] = (), **tags: str) -> int:
        refs = member("left", left) + member("right", right)
        refs += "".join(member("regulatory_element", rule, "relation") for rule in rules)
        return self._add("relation", refs, {"type": "lanelet", "subtype": "road", **tags})

    def lane(self, left: Sequence[Point], right: Sequence[Point], **tags: str) -> int:
        return self.lanelet(self.way(left), self.way(right), (), **tags)

    def rule(self, subtype: str, members: str = "", **tags: str) -> int:
        return self._add("relation", members, {"type": "regulatory_element", **tags}, subtype)

    def _add(self, element: str, content: str, tags: dict[str, str], subtype: str = "") -> int:
        self._id += 1
        found = tags | ({"subtype": subtype} if subtype else {})
        written = "".join(f'<tag k="{key}" v="{value}"/>' for key, value in found.items())
        self._parts.append(f'<{element} id="{self._id}">{content}{written}</{element}>')
        return self._id

    def write(self) -> str:
        nodes = [_write_node(node, point) for point, node in self._nodes.items()]
        return "\n".join(["<osm>", *nodes, *self._parts, "</osm>"])


def member(role: str, ref: int, kind: str = "way") -> str:
    return f'<member type="{kind}" ref="{ref}" role="{role}"/>'


def _write_node(node: int, point: Point) -> str:
    keys = zip(("local_x", "local_y", "ele"), point, strict=False)
    tags = "".join(f'<tag k="{key}" v="{value!r}"/>' for key, value in keys)
    return f'<node id="{node}" lat="" lon="">{tags}</node>'


def import_text(folder: Path, text: str, **declared: object) -> MapNetwork:
    """Import a map; what is declared is of the map's file or of the road."""
    (folder / "map.osm").write_text(text, encoding="utf-8")
    of_file = {key: value for key, value in declared.items() if key in MapFile.model_fields}
    of_road = {key: value for key, value in declared.items() if key not in of_file}
    file = MapFile.model_validate({"source": "lanelet2", "file": "map.osm", **of_file})
    described = Road.model_validate(declaration("lanelet2", "map.osm", **of_road))
    return import_map(file, described, folder)


def import_lanelets(folder: Path, lanelets: LaneletMap) -> SumoNetwork:
    return parse_packed_network(import_text(folder, lanelets.write()).network)


def find_streets(network: SumoNetwork) -> dict[str, SumoEdge]:
    return {edge.id: edge for edge in network.edges if edge.function == "normal"}


def get_street(network: SumoNetwork, lanelet: int) -> SumoEdge:
    """Find the street that is named after a lanelet, in either direction."""
    return next(it for it in network.edges if it.id[:-1] == f"lanelet_{lanelet}")

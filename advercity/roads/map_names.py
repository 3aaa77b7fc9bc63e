"""Names for the streets and junctions of an imported network, as authored roads have them.

The two directions of a street become `<street>+` and `<street>-`. Streets take their name in the
map, else the id of their road or way, and are numbered if several pieces share it. `7th Avenue` and
`North` become `street_7th_avenue` and `street_north`: ids begin with a letter, and `north` is an
arm of a junction. Junctions are `j` and their id in the map, or the id of one of their nodes. So a
name leads back to the place in the map.
"""

import re
import unicodedata
from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from html import unescape
from xml.etree.ElementTree import Element

from advercity_dsl.base import ID_PATTERN

from advercity.roads.imported_network import ImportedNetwork
from advercity.roads.junction_arms import COMPASS_RAD, RELATIVE_RAD
from advercity.roads.network_file import SumoEdge, parse_network
from advercity.roads.streets import parse_edge_id, sumo_edge_id

MAX_NAME_LENGTH = 40
"""Names of streets and junctions are parts of ids of scenarios, which are limited."""
JOINED_NAME = re.compile(r"cluster_([^_]+)_")
"""netconvert's name of a junction joined from several nodes of the map."""
ARM_WORDS = frozenset(COMPASS_RAD) | frozenset(RELATIVE_RAD)
"""Words for arms of a junction, where a declaration may also name a street."""


def read_street_names(root: Element) -> dict[str, str]:
    """Read the names copied from the map by netconvert, by edge."""
    # netconvert writes `&apos;` as text.
    return {item.attrib["id"]: unescape(item.get("name", "")) for item in root.iter("edge")}


def rename_network(net: Element, names: Mapping[str, str]) -> None:
    """Rename streets, junctions and lights of a network in place.

    Args:
        net: A sanitised network.
        names: Names of edges in the map; those without one are named by their id.
    """
    edges = _name_edges(ImportedNetwork.from_network(parse_network(net)), names)
    places = [item.attrib["id"] for item in net.iter("junction") if item.get("type") != "internal"]
    nodes = _number_names({name: _name_junction(name) for name in places})
    rename = _Renamer(edges, nodes)
    lights = [item.attrib["id"] for item in net.iter("tlLogic")]
    rename.lights = _number_names(
        {name: nodes.get(name, f"light_{_slug(name)}") for name in dict.fromkeys(lights)}
    )
    for item in net.iter():
        for attribute, value in list(item.attrib.items()):
            change = rename.get_change(item.tag, attribute)
            if change is not None:
                item.set(attribute, " ".join(change(text) for text in value.split()))


def _name_junction(name: str) -> str:
    """Name a junction as in an authored network, or by its id in the map, or one of several."""
    joined = JOINED_NAME.match(name)
    if joined is not None:
        return f"j{_slug(joined[1])}"
    return name if re.fullmatch(ID_PATTERN, name) else f"j{_slug(name)}"


def _name_edges(network: ImportedNetwork, names: Mapping[str, str]) -> dict[str, str]:
    """Name every edge by its street and direction."""
    if _is_named_by_streets(network):
        return {edge: edge for edge in network.edges}
    streets = list(_pair_directions(network))
    wanted = {
        edge.id: _name_street(names.get(edge.id, "")) or f"road_{_slug(get_map_id(edge.id))}"
        for edge, _ in streets
    }
    numbered = _number_names(wanted)
    renamed: dict[str, str] = {}
    for edge, opposite in streets:
        renamed[edge.id] = sumo_edge_id(numbered[edge.id], along=True)
        if opposite is not None:
            renamed[opposite.id] = sumo_edge_id(numbered[edge.id], along=False)
    return renamed


def _is_named_by_streets(network: ImportedNetwork) -> bool:
    """Return whether all edges are directions of streets, as in our own networks.

    A single name is no evidence: foreign networks also have lower-case ids.
    """
    for edge in network.edges.values():
        try:
            street, along = parse_edge_id(edge.id)
        except KeyError:
            return False
        opposite = network.edges.get(sumo_edge_id(street, along=not along))
        if not re.fullmatch(ID_PATTERN, street) or (opposite is None and not along):
            return False
        if opposite is not None and not _leads_back(edge, opposite):
            return False
    return True


def _leads_back(edge: SumoEdge, opposite: SumoEdge) -> bool:
    ends = opposite.to_junction, opposite.from_junction
    return (edge.from_junction, edge.to_junction) == ends


def _pair_directions(network: ImportedNetwork) -> Iterable[tuple[SumoEdge, SumoEdge | None]]:
    paired: set[str] = set()
    for edge in network.edges.values():
        if edge.id in paired:
            continue
        opposite = network.find_opposite_edge(edge)
        if opposite is not None and network.find_opposite_edge(opposite) is not edge:
            opposite = None
        if opposite is not None and not edge.driving_lanes:
            edge, opposite = opposite, edge
        paired |= {item.id for item in (edge, opposite) if item}
        yield edge, opposite


def get_map_id(edge: str) -> str:
    """Return the id in the map of an edge; netconvert marks directions and pieces."""
    return edge.lstrip("-").partition("#")[0]


def _name_street(name: str) -> str:
    """Name a street as the map does, by an id; empty if no part of its name is left."""
    plain = _slug(name)
    return f"street_{plain}" if plain[:1].isdigit() or plain in ARM_WORDS else plain


def _number_names(wanted: Mapping[str, str]) -> dict[str, str]:
    """Number shared names: `main_street_1`, `main_street_2`."""
    shared = {name for name, count in Counter(wanted.values()).items() if count > 1}
    taken = set(wanted.values()) - shared
    found: dict[str, str] = {}
    for key, name in wanted.items():
        number = 0
        unique = name
        while name in shared and (unique == name or unique in taken):
            number += 1
            unique = f"{name}_{number}"
        taken.add(unique)
        found[key] = unique
    return found


def _slug(text: str) -> str:
    """Turn a name into an id: ASCII letters, digits and underscores."""
    plain = unicodedata.normalize("NFKD", text.replace("ß", "ss")).encode("ascii", "ignore")
    return re.sub(r"[^a-z0-9]+", "_", plain.decode().lower()).strip("_")[:MAX_NAME_LENGTH]


class _Renamer:
    """Changes ids, wherever a network refers to them."""

    def __init__(self, edges: Mapping[str, str], junctions: Mapping[str, str]) -> None:
        self._edges = edges
        self._junctions = junctions
        self.lights: Mapping[str, str] = {}

    def get_change(self, tag: str, attribute: str) -> Callable[[str], str] | None:
        """Return how the words of an attribute change; None if they are no ids."""
        match tag, attribute:
            case ("edge", "id" | "crossingEdges") | ("roundabout", "edges"):
                return self._edge
            case ("edge" | "connection", "from" | "to"):
                return self._junction if tag == "edge" else self._edge
            case ("lane", "id") | ("connection", "via") | ("junction", "incLanes" | "intLanes"):
                return self._lane
            case ("junction", "id") | ("roundabout", "nodes"):
                return self._junction
            case ("tlLogic", "id") | ("connection", "tl"):
                return lambda text: self.lights.get(text, text)
            case _:
                return None

    def _edge(self, text: str) -> str:
        if not text.startswith(":"):
            return self._edges.get(text, text)
        junction, _, number = text[1:].rpartition("_")
        return f":{self._junctions.get(junction, junction)}_{number}"

    def _lane(self, text: str) -> str:
        edge, _, index = text.rpartition("_")
        return f"{self._edge(edge)}_{index}"

    def _junction(self, text: str) -> str:
        # Internal junctions are named by the lane at whose end they are.
        return self._lane(text) if text.startswith(":") else self._junctions.get(text, text)

"""A SUMO network as others build them: four streets that meet, two lanes each, and a light."""

from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from xml.etree.ElementTree import Element

from advercity.foreign.xml_documents import parse_xml
from advercity.roads.sumo_network import run_netconvert

ARM_M = 100.0
ARMS = {"north": (0, 1), "east": (1, 0), "south": (0, -1), "west": (-1, 0)}
"""Ids of the outer nodes, and their directions from the middle `mid`."""


@cache
def build_crossing_network(*options: tuple[str, str], middle: tuple[float, float] = (0, 0)) -> str:
    """Build the network; its edges are `in_<arm>` and `out_<arm>`.

    Args:
        options: More options of netconvert, each name and value.
        middle: Place of its junction.
    """
    nodes = [f'<node id="mid" x="{middle[0]}" y="{middle[1]}" type="traffic_light"/>']
    edges: list[str] = []
    lanes = 'numLanes="2" speed="13.89" sidewalkWidth="2"'
    for arm, way in ARMS.items():
        x, y = (start + ARM_M * step for start, step in zip(middle, way, strict=True))
        nodes.append(f'<node id="{arm}" x="{x}" y="{y}"/>')
        edges.append(f'<edge id="in_{arm}" from="{arm}" to="mid" {lanes}/>')
        edges.append(f'<edge id="out_{arm}" from="mid" to="{arm}" {lanes}/>')
    with TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "n.xml").write_text(f"<nodes>{''.join(nodes)}</nodes>", encoding="utf-8")
        (folder / "e.xml").write_text(f"<edges>{''.join(edges)}</edges>", encoding="utf-8")
        chosen = {
            "node-files": "n.xml",
            "edge-files": "e.xml",
            "crossings.guess": "true",
            **dict(options),
        }
        outcome = run_netconvert(chosen, folder / "town.net.xml")
        assert outcome.succeeded, outcome.messages
        return (folder / "town.net.xml").read_text(encoding="utf-8")


def parse_crossing_network(*options: tuple[str, str]) -> Element:
    """Parse the network into elements that a test may change."""
    return parse_xml(build_crossing_network(*options).encode())

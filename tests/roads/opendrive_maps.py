"""OpenDRIVE documents that tests write, and the roads that are imported from them."""

from pathlib import Path

from advercity_dsl import MapFile, MapNetwork, Road

from advercity.roads.map_import import import_map
from tests.roads.imported_roads import declaration


def cubic(name: str, at: float, *coefficients: float, begins: str = "s") -> str:
    values = [*coefficients, 0.0, 0.0, 0.0, 0.0][:4]
    terms = " ".join(f'{key}="{value!r}"' for key, value in zip("abcd", values, strict=True))
    return f'<{name} {begins}="{at!r}" {terms}/>'


def lane(lane_id: int, kind: str, *widths: tuple[float, ...] | float, inner: str = "") -> str:
    """Write a lane; widths are numbers, or a distance and coefficients from there on."""
    pieces = [item if isinstance(item, tuple) else (0.0, item) for item in widths]
    written = "".join(cubic("width", *piece, begins="sOffset") for piece in pieces)
    return f'<lane id="{lane_id}" type="{kind}">{inner}{written}</lane>'


def section(at: float, *lanes: str) -> str:
    left = [item for item in lanes if 'id="-' not in item.partition(" type")[0]]
    right = [item for item in lanes if item not in left]
    sides = "".join(
        f"<{name}>{''.join(found)}</{name}>"
        for name, found in (("left", left), ("right", right))
        if found
    )
    return f'<laneSection s="{at!r}">{sides}</laneSection>'


def road(
    road_id: str,
    length: float,
    sections: str,
    *,
    start: tuple[float, float, float] = (0.0, 0.0, 0.0),
    shape: str = "<line/>",
    before_lanes: str = "",
    link: str = "",
    attributes: str = "",
    junction: str = "-1",
) -> str:
    x, y, heading = start
    geometry = f'<geometry s="0" x="{x!r}" y="{y!r}" hdg="{heading!r}" length="{length!r}">{shape}'
    return (
        f'<road id="{road_id}" name="Road {road_id}" length="{length!r}" junction="{junction}"'
        f" {attributes}>"
        f"<link>{link}</link><planView>{geometry}</geometry></planView>{before_lanes}"
        f"<lanes>{sections}</lanes></road>"
    )


def linked(side: str, kind: str, name: str, contact: str = "") -> str:
    """Write the link of a road to another or to a junction."""
    point = f' contactPoint="{contact}"' if contact else ""
    return f'<{side} elementType="{kind}" elementId="{name}"{point}/>'


def connection(incoming: str, connecting: str, contact: str, *lanes: tuple[int, int]) -> str:
    links = "".join(f'<laneLink from="{one}" to="{other}"/>' for one, other in lanes)
    return (
        f'<connection incomingRoad="{incoming}" connectingRoad="{connecting}"'
        f' contactPoint="{contact}">{links}</connection>'
    )


def import_text(folder: Path, *parts: str, header: str = "", **declared: object) -> MapNetwork:
    (folder / "map.xodr").write_text(
        f"<OpenDRIVE><header>{header}</header>{''.join(parts)}</OpenDRIVE>", encoding="utf-8"
    )
    described = Road.model_validate(declaration("opendrive", "map.xodr", **declared))
    return import_map(MapFile(source="opendrive", file="map.xodr"), described, folder)


def declare(network: MapNetwork, **declared: object) -> Road:
    described = Road.model_validate(declaration("opendrive", "map.xodr", **declared))
    return described.model_copy(update={"imported": network})

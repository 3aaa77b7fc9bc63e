"""Surroundings in OpenStreetMap extracts: buildings, trees, lamps, fields, water."""

import re
from collections.abc import Iterator
from functools import cached_property
from pathlib import Path

import numpy as np
import shapely
from advercity_dsl import MapFile, Road
from advercity_dsl.road import BuildingUse, Roof, Species, Surrounding, SurroundingKind
from advercity_dsl.units import Point2
from shapely.geometry.base import BaseGeometry

from advercity.errors import InputError
from advercity.geometry.mesh import extract_polygons
from advercity.geometry.polyline import Points
from advercity.randomness import create_generator
from advercity.roads.map_files import read_map_file
from advercity.roads.osm_map import OsmMap, Tags
from advercity.roads.road_network import build_road

MAX_SURROUNDINGS = 5000
MAX_DISTANCE_M = 120.0
"""Distance from paving beyond which surroundings are left out."""
CLEARANCE_M = 0.6
"""Distance of masts, trees, walls and buildings from paving, whose width maps seldom have."""
TREE_CLEARANCE_M = 3.5
"""Distance of trunks from paving, to keep crowns out of the way of vehicles."""
MIN_LEFT_FRACTION = 0.5
"""Least fraction of a building off the paving."""
MIN_AREA_M2, MIN_LINE_M = 6.0, 1.0
SIMPLIFY_M = 0.3
STOREY_M = 3.1
LOW_BUILDINGS = {
    "garage": 2.8,
    "garages": 2.8,
    "carport": 2.6,
    "shed": 2.6,
    "roof": 4.0,
    "kiosk": 3.0,
    "greenhouse": 3.5,
    "hut": 2.8,
}
"""Heights of buildings without storeys, by their tag."""
ROOFS: dict[str, Roof] = {
    "flat": "flat",
    "skillion": "flat",
    "gabled": "gabled",
    "gambrel": "gabled",
    "saltbox": "gabled",
    "hipped": "hipped",
    "half-hipped": "hipped",
    "pyramidal": "hipped",
    "mansard": "hipped",
    "dome": "hipped",
}
USES: dict[tuple[str, str], BuildingUse] = {
    ("building", "house"): "residential",
    ("building", "detached"): "residential",
    ("building", "apartments"): "residential",
    ("building", "residential"): "residential",
    ("building", "retail"): "commercial",
    ("building", "commercial"): "commercial",
    ("building", "office"): "commercial",
    ("building", "supermarket"): "commercial",
    ("building", "industrial"): "industrial",
    ("building", "warehouse"): "industrial",
    ("building", "hangar"): "industrial",
    ("landuse", "residential"): "residential",
    ("landuse", "retail"): "commercial",
    ("landuse", "commercial"): "commercial",
    ("landuse", "industrial"): "industrial",
    ("landuse", "railway"): "industrial",
}
"""Uses of buildings by their own tag, or else by the tag of their land."""
LINES = {
    ("barrier", "wall"): SurroundingKind.WALL,
    ("barrier", "retaining_wall"): SurroundingKind.WALL,
    ("barrier", "city_wall"): SurroundingKind.WALL,
    ("barrier", "fence"): SurroundingKind.FENCE,
    ("barrier", "guard_rail"): SurroundingKind.FENCE,
    ("barrier", "hedge"): SurroundingKind.HEDGE,
    ("natural", "tree_row"): SurroundingKind.TREES,
}
AREAS = {
    ("landuse", "farmland"): SurroundingKind.CROPS,
    ("landuse", "vineyard"): SurroundingKind.CROPS,
    ("landuse", "orchard"): SurroundingKind.CROPS,
    ("landuse", "farmyard"): SurroundingKind.FIELD,
    ("landuse", "construction"): SurroundingKind.FIELD,
    ("landuse", "brownfield"): SurroundingKind.FIELD,
    ("landuse", "forest"): SurroundingKind.WOODS,
    ("natural", "wood"): SurroundingKind.WOODS,
    ("natural", "water"): SurroundingKind.WATER,
    ("waterway", "riverbank"): SurroundingKind.WATER,
    ("leisure", "swimming_pool"): SurroundingKind.WATER,
}
"""Kinds by tag; grass and meadow are the ground's default."""
STREET_TREES = (Species.OAK, Species.MAPLE, Species.BIRCH)
"""Trees whose crowns begin above vehicles."""
POINTS: dict[tuple[str, str], tuple[SurroundingKind, tuple[Species, ...]]] = {
    ("natural", "tree"): (SurroundingKind.TREES, STREET_TREES),
    ("highway", "street_lamp"): (SurroundingKind.LAMP, ()),
}
WOOD_EDGE_M = 45.0
"""Distance from paving up to which woods consist of single trees."""
TREE_SPACING_M, MAX_TREES = 7.0, 1500


def read_surroundings(declared: MapFile, road: Road, folder: Path) -> tuple[Surrounding, ...]:
    """Read the surroundings of an extract near the streets of its imported road.

    Args:
        declared: The map; other than extracts have no surroundings.
        road: The road with its network.
        folder: Base of the map's path.

    Raises:
        InputError: There are too many.
    """
    if declared.source != "osm":
        return ()
    paving = build_road(road).paved_area
    places = _Places(OsmMap.around(road, read_map_file(declared, folder).root), paving)
    found = (*places.iterate_buildings(), *places.iterate_areas(), *places.iterate_others())
    if len(found) > MAX_SURROUNDINGS:
        raise InputError(
            f"{declared.file}: has {len(found)} things near its streets, at most"
            f" {MAX_SURROUNDINGS} are drawn; cut a part out of it with `extent_m`"
        )
    return found


class _Places:
    """Surroundings of an extract, near paving but not on it."""

    def __init__(self, osm: OsmMap, paving: BaseGeometry) -> None:
        self._osm = osm
        self._near = shapely.buffer(paving, MAX_DISTANCE_M)
        self._taken = shapely.buffer(paving, CLEARANCE_M)
        self._below_crowns = shapely.buffer(paving, TREE_CLEARANCE_M)
        self._seen = shapely.buffer(paving, WOOD_EDGE_M)
        shapely.prepare(self._near)
        shapely.prepare(self._seen)
        shapely.prepare(self._taken)

    def iterate_buildings(self) -> Iterator[Surrounding]:
        for tags, polygon in self._osm.areas:
            if tags.get("building", "no") == "no" or tags.get("location") == "underground":
                continue
            if not shapely.intersects(self._near, polygon):
                continue
            left = shapely.difference(polygon, self._taken)
            if left.area < max(MIN_AREA_M2, MIN_LEFT_FRACTION * polygon.area):
                continue
            use = self._find_use(tags, polygon)
            for outline in _list_outlines(left):
                yield Surrounding(
                    kind=SurroundingKind.BUILDINGS,
                    line_m=outline,
                    height_m=_read_height(tags),
                    roof=ROOFS.get(tags.get("roof:shape", "")),
                    use=use,
                )

    def _find_use(self, tags: Tags, building: shapely.Polygon) -> BuildingUse | None:
        """Find the use of a building, if it is known; garages and the like have none."""
        own: BuildingUse | None = USES.get(("building", tags["building"]))
        if own is not None or tags["building"] in LOW_BUILDINGS:
            return own
        middle = shapely.point_on_surface(building)
        for use, land in self._land_uses:
            if shapely.contains(land, middle):
                return use
        return None

    @cached_property
    def _land_uses(self) -> list[tuple[BuildingUse, shapely.Polygon]]:
        """Land with a use, the smallest first, since larger areas are rougher."""
        found: list[tuple[BuildingUse, shapely.Polygon]] = []
        for tags, polygon in self._osm.areas:
            use = USES.get(("landuse", tags.get("landuse", "")))
            if use is not None:
                found.append((use, polygon))
        return sorted(found, key=lambda item: item[1].area)

    def iterate_areas(self) -> Iterator[Surrounding]:
        for number, (tags, polygon) in enumerate(self._osm.areas):
            kind = _find_kind(tags, AREAS)
            if kind is None:
                continue
            if kind is SurroundingKind.WOODS:
                at_m = self._plant_trees(polygon, number)
                if at_m:
                    yield Surrounding(kind=SurroundingKind.TREES, at_m=at_m)
                polygon = shapely.difference(polygon, self._seen)
            for outline in _list_outlines(shapely.intersection(polygon, self._near)):
                yield Surrounding(kind=kind, line_m=outline)

    def _plant_trees(self, wood: shapely.Polygon, number: int) -> tuple[Point2, ...]:
        """Place the trees of a wood near streets; the rest is one outline."""
        west, south, east, north = wood.bounds
        x, y = np.meshgrid(
            np.arange(west, east, TREE_SPACING_M), np.arange(south, north, TREE_SPACING_M)
        )
        draw = create_generator("woods of the map", number)
        points = np.column_stack([x.ravel(), y.ravel()])
        points += draw.uniform(0, 0.8 * TREE_SPACING_M, points.shape)
        places = shapely.points(points)
        chosen = shapely.intersects(wood, places) & shapely.intersects(self._seen, places)
        return self._select_points(points[chosen], SurroundingKind.TREES)[:MAX_TREES]

    def iterate_others(self) -> Iterator[Surrounding]:
        for (key, value), (kind, species) in POINTS.items():
            points = np.array(self._osm.list_points(key, value)).reshape(-1, 2)
            at_m = self._select_points(points, kind)
            if at_m:
                yield Surrounding(kind=kind, at_m=at_m, species=species)
        for tags, points in self._osm.lines:
            kind = _find_kind(tags, LINES)
            if kind is None:
                continue
            free = shapely.intersection(shapely.LineString(points), self._near)
            for part in shapely.get_parts(shapely.difference(free, self._get_taken(kind))):
                line = shapely.simplify(part, SIMPLIFY_M)
                if line.length > MIN_LINE_M:
                    height_m = _parse_metres(tags.get("height", ""))
                    species = STREET_TREES if kind is SurroundingKind.TREES else ()
                    yield Surrounding(
                        kind=kind, line_m=_round(line), height_m=height_m, species=species
                    )

    def _select_points(self, points: Points, kind: SurroundingKind) -> tuple[Point2, ...]:
        places = shapely.points(points)
        taken = shapely.intersects(self._get_taken(kind), places)
        return _round_points(points[shapely.intersects(self._near, places) & ~taken])

    def _get_taken(self, kind: SurroundingKind) -> BaseGeometry:
        return self._below_crowns if kind is SurroundingKind.TREES else self._taken


def _find_kind(tags: Tags, kinds: dict[tuple[str, str], SurroundingKind]) -> SurroundingKind | None:
    return next((kind for (key, value), kind in kinds.items() if tags.get(key) == value), None)


def _list_outlines(area: BaseGeometry) -> Iterator[tuple[Point2, ...]]:
    for polygon in extract_polygons(area):
        plain = shapely.simplify(shapely.Polygon(polygon.exterior), SIMPLIFY_M)
        for part in extract_polygons(plain):
            if part.area > MIN_AREA_M2:
                yield _round_points(shapely.get_coordinates(part.exterior)[:-1])


def _round(line: BaseGeometry) -> tuple[Point2, ...]:
    return _round_points(shapely.get_coordinates(line))


def _round_points(points: Points) -> tuple[Point2, ...]:
    return tuple((float(x), float(y)) for x, y in points.round(2).tolist())


def _read_height(tags: Tags) -> float | None:
    """Read the height of a building, from its storeys if need be."""
    height_m = _parse_metres(tags.get("height", ""))
    if height_m is not None:
        return height_m
    storeys = _parse_metres(tags.get("building:levels", ""))
    if storeys is not None:
        roof = _parse_metres(tags.get("roof:levels", "")) or 0.0
        return round(STOREY_M * (storeys + roof), 1)
    return LOW_BUILDINGS.get(tags["building"])


def _parse_metres(text: str) -> float | None:
    """Parse a number of metres (`12`, `12.5 m`), or of feet (`40'`); None for anything else."""
    found = re.fullmatch(r"\s*(\d+(?:\.\d+)?)\s*(m|'|ft)?\s*", text)
    if found is None:
        return None
    value = float(found[1]) * (1.0 if found[2] in (None, "m") else 0.3048)
    return value if 0.5 <= value <= 500 else None

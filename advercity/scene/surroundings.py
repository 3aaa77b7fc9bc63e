"""Builds the declared surroundings of a road: buildings, vegetation, roadside objects, fields."""

from collections.abc import Callable, Iterator, Sequence
from itertools import chain

import numpy as np
import shapely
from advercity_dsl import RoadsideUnit
from advercity_dsl.road import LampType, Season, Surrounding, SurroundingKind
from advercity_dsl.units import KM_H_PER_M_S, Point2
from shapely.geometry.base import BaseGeometry

from advercity.errors import InputError
from advercity.geometry.arrays import Float64Array
from advercity.geometry.mesh import Mesh, MeshPart, build_meshes
from advercity.roads.road_network import RoadNetwork
from advercity.scene import (
    barriers,
    buildings,
    crops,
    footprints,
    roadside,
    skyline,
    vegetation,
    woods,
)
from advercity.scene.buildings import Lot, LotPattern
from advercity.scene.furniture import build_furniture
from advercity.scene.seasons import apply_season
from advercity.scene.site import (
    GroundHeight,
    Rectangle,
    Site,
    StreetSide,
    resolve_street_sides,
    space_points_along,
)
from advercity.scene.street_lamps import build_street_lamp, choose_lamp_type
from advercity.scene.traffic_signs import build_sign, build_speed_sign
from advercity.world import StreetLamp

SENSOR_CLEARANCE_M = 6.0
"""Distance from roadside units without trees and buildings."""
LINE_CLEARANCE_M = 0.2
"""Distance of fences, hedges and walls along a street from paving, so side streets stay open."""
LINE_WIDTH_M, MAST_RADIUS_M, SHELTER_RADIUS_M, SIGN_RADIUS_M = 0.4, 0.2, 2.8, 0.5
"""Extents without street furniture."""
_SIGN_KINDS = (SurroundingKind.SPEED_SIGN, SurroundingKind.SIGN)
_BUILDING_KINDS = (SurroundingKind.BUILDINGS, SurroundingKind.HOUSES)
_OUTLINED_KINDS = (
    SurroundingKind.BUILDINGS,
    SurroundingKind.CROPS,
    SurroundingKind.FIELD,
    SurroundingKind.WOODS,
)
_LINE_BUILDERS: dict[
    SurroundingKind, Callable[[Sequence[Point2], float | None, Site, str], list[MeshPart]]
] = {
    SurroundingKind.WALL: lambda line, height, site, _: roadside.build_wall(line, height, site),
    SurroundingKind.FENCE: lambda line, height, site, _: roadside.build_fence(line, height, site),
    SurroundingKind.HEDGE: roadside.build_hedge,
    SurroundingKind.GUARD_RAIL: lambda line, height, site, _: barriers.build_guard_rail(
        line, height, site
    ),
    SurroundingKind.BOLLARDS: lambda line, height, site, _: barriers.build_bollards(
        line, height, site
    ),
    SurroundingKind.POWER_LINE: lambda line, height, site, _: barriers.build_power_line(
        line, height, site
    ),
}
_POINT_BUILDERS: dict[SurroundingKind, Callable[[Point2, float | None, Site], list[MeshPart]]] = {
    SurroundingKind.BUS_STOP: lambda at, _, site: roadside.build_bus_stop(at, site),
    SurroundingKind.TOWER: roadside.build_tower,
    SurroundingKind.POLE: roadside.build_pole,
}
_FIELD_BUILDERS: dict[
    SurroundingKind, Callable[[Float64Array, float | None, Site, str], list[MeshPart]]
] = {
    SurroundingKind.CROPS: crops.build_crops,
    SurroundingKind.FIELD: lambda rows, _, site, key: crops.build_tilled_field(rows, site, key),
}


def build_surroundings(
    network: RoadNetwork, ground_height: GroundHeight, paved_area: BaseGeometry
) -> tuple[list[Mesh], list[StreetLamp], Site]:
    """Build meshes of the surroundings, one per material and class, and the lights among them.

    The returned site is the ground left by buildings, drives and water.

    The road's id and the order of its surroundings are keys of all random draws. The paved area
    stays free; masts and shelters are where they are declared.

    Raises:
        InputError: A declaration begins beyond the end of its street.
    """
    season = network.declaration.season or Season.SUMMER
    open_ground = Site(ground_height, paved_area, network.street_axes, paved_area, season)
    site = open_ground.exclude(_find_sensor_clearances(network))
    declared = network.declaration.surroundings
    items = [_PlacedSurrounding(network, number, item) for number, item in enumerate(declared)]
    parts: list[MeshPart] = []
    lamps: list[StreetLamp] = []
    # Buildings take their ground first, outlined ones before others: nothing may grow into them.
    outlined = [item for item in items if item.kind in _BUILDING_KINDS and item.outline]
    for item in outlined:
        parts += _build_on_outline(item, site)
    taken = [item.outline for item in outlined if item.outline]
    if taken:
        site, open_ground = site.exclude(taken), open_ground.exclude(taken)
    for item in items:
        if item.kind in _BUILDING_KINDS and not item.outline:
            built, footprints = _build_buildings(item, site)
            parts += built
            site, open_ground = site.exclude(footprints), open_ground.exclude(footprints)
    for item in items:
        if item.kind is SurroundingKind.LAMP:
            for point in item.sample_points():
                lamp_type = item.declaration.lamp or _choose_lamp_type(network, point)
                mast, light = build_street_lamp(point, item.height_m, lamp_type, site)
                parts += mast
                lamps.append(light)
        elif item.kind in _FIELD_BUILDERS:
            # Plants of a field are low: sensors look over them.
            parts += _build_fields(item, open_ground)
        else:
            parts += _build_objects(item, site)
    obstacles = [thing for item in items for thing in item.outline_obstacles(paved_area)]
    for item in items:
        if density := item.declaration.per_100_m:
            parts += build_furniture(item.sides, density, obstacles, site, item.random_key)
    meshes = list(apply_season(build_meshes(parts, "surroundings_"), season))
    return (
        meshes,
        lamps,
        open_ground.exclude([area for item in items for area in item.outline_covered_ground()]),
    )


def _find_sensor_clearances(network: RoadNetwork) -> list[BaseGeometry]:
    return [
        shapely.Point(agent.position_m[:2]).buffer(SENSOR_CLEARANCE_M)
        for agent in network.declaration.agents.values()
        if isinstance(agent, RoadsideUnit)
    ]


class _PlacedSurrounding:
    def __init__(self, network: RoadNetwork, number: int, declaration: Surrounding) -> None:
        road = network.declaration
        self.declaration = declaration
        self.kind = declaration.kind
        self.height_m = declaration.height_m
        self.random_key = f"{road.id}/{number}/{declaration.seed}"
        self.sides: list[StreetSide] = []
        if declaration.beside:
            try:
                self.sides = resolve_street_sides(declaration.beside, network.streets)
            except InputError as error:
                raise InputError(f"road '{road.id}', surroundings.{number}: {error}") from error

    @property
    def bands(self) -> list[StreetSide | Rectangle]:
        """Bands along the street, the rectangular area, and the one around the outline."""
        area = self.declaration.area_m
        if self.outline is not None:
            west, south, east, north = self.outline.bounds
            area = (west, south), (east, north)
        return [*self.sides, *([Rectangle.from_corners(area)] if area else [])]

    @property
    def outline(self) -> shapely.Polygon | None:
        """The outline in the declaration, for kinds with one."""
        if self.kind not in _OUTLINED_KINDS or not self.declaration.line_m:
            return None
        return shapely.Polygon(self.declaration.line_m)

    def limit_to_outline(self, site: Site) -> Site:
        """Reserve the ground between an outline and the band around it."""
        if self.outline is None:
            return site
        return site.exclude([shapely.difference(shapely.box(*self.outline.bounds), self.outline)])

    @property
    def is_row(self) -> bool:
        """Whether trees are placed in rows, rather than scattered over ground."""
        return not self.declaration.area_m and all(side.depth_m == 0.0 for side in self.sides)

    def sample_points(self) -> list[Point2]:
        """List the positions of lamps, poles and other single objects."""
        spacing = self.declaration.spacing_m or roadside.LAMP_SPACING_M
        rows = [side.space_points(spacing, side.near_offset_m) for side in self.sides]
        rows.append(space_points_along(self.declaration.line_m, spacing))
        return [*self.declaration.at_m, *((float(x), float(y)) for x, y in np.concatenate(rows))]

    def scatter_trees(self) -> Float64Array:
        """Sample the positions (n, 2) of trees."""
        spacing = self.declaration.spacing_m or vegetation.TREE_SPACING_M
        rows = [vegetation.scatter_points(band, spacing, self.random_key) for band in self.bands]
        rows += [
            np.reshape(self.declaration.at_m, (-1, 2)),
            space_points_along(self.declaration.line_m, spacing),
        ]
        return np.concatenate(rows)

    def place_lots(self, pattern: LotPattern) -> list[Lot]:
        """Place lots of buildings in all bands; some may turn out not to be buildable."""
        spacing = self.declaration.spacing_m
        rows = (
            buildings.place_lots(band, pattern, spacing, self.random_key) for band in self.bands
        )
        return list(chain.from_iterable(rows))

    def find_lines(self, paved_area: BaseGeometry) -> Iterator[tuple[Point2, ...]]:
        """Find the lines of walls, fences and hedges; along streets without paved ground."""
        if self.declaration.line_m:
            yield self.declaration.line_m
        for side in self.sides:
            points = side.offset_line(side.near_offset_m)
            if len(points) < 2:
                continue
            paved = shapely.buffer(paved_area, LINE_CLEARANCE_M)
            free = shapely.difference(shapely.LineString(points), paved)
            for part in shapely.get_parts(free):
                if part.length > 1.0:
                    yield tuple((float(x), float(y)) for x, y in part.coords)

    def outline_covered_ground(self) -> Iterator[BaseGeometry]:
        """Outline where paving of its own, or water, lies on the ground."""
        if self.kind in (SurroundingKind.DRIVEWAY, SurroundingKind.PAVING):
            for side in self.sides:
                lines = [side.offset_line(at) for at in (side.near_offset_m, side.far_offset_m)]
                outline = np.concatenate([lines[0], lines[1][::-1]])
                if len(outline) > 2:
                    yield shapely.make_valid(shapely.Polygon(outline))
        elif self.kind is SurroundingKind.WATER:
            yield shapely.make_valid(shapely.Polygon(self.declaration.line_m))

    def outline_obstacles(self, paved_area: BaseGeometry) -> Iterator[BaseGeometry]:
        """Outline obstacles to street furniture: walls, masts, shelters, drives."""
        if self.kind in _LINE_BUILDERS:
            lines = self.find_lines(paved_area)
            yield from (
                shapely.buffer(shapely.LineString(line), LINE_WIDTH_M / 2) for line in lines
            )
        elif self.kind is SurroundingKind.LAMP or self.kind in _POINT_BUILDERS:
            radius_m = SHELTER_RADIUS_M if self.kind is SurroundingKind.BUS_STOP else MAST_RADIUS_M
            yield from (shapely.Point(at).buffer(radius_m) for at in self.sample_points())
        elif self.kind in _SIGN_KINDS or self.kind is SurroundingKind.DRIVEWAY:
            for side in self.sides:
                end_m = 0.0 if self.kind in _SIGN_KINDS else side.length_m
                ends = side.points_at([0.0, end_m], side.near_offset_m)
                yield shapely.LineString(ends).buffer(SIGN_RADIUS_M)


def _choose_lamp_type(network: RoadNetwork, point: Point2) -> LampType:
    """Choose the type of the lamps of the street nearest to a point."""
    here, streets = shapely.Point(point), network.streets.values()
    limits_m_s = {
        shapely.LineString(item.axis[:, :2]).distance(here): item.speed_limit_m_s
        for item in streets
    }
    # An imported road has no streets: its land use decides.
    limit_m_s = limits_m_s[min(limits_m_s)] if limits_m_s else 0.0
    return choose_lamp_type(network.declaration.land_use, limit_m_s)


def _build_buildings(
    item: _PlacedSurrounding, site: Site
) -> tuple[list[MeshPart], list[shapely.Polygon]]:
    if item.kind is SurroundingKind.HOUSES:
        lots = item.place_lots(buildings.HOUSE_LOTS)
        return buildings.build_houses(lots, item.height_m, site, item.random_key)
    lots = item.place_lots(buildings.TOWN_LOTS)
    return buildings.build_town_blocks(lots, item.height_m, site, item.random_key)


def _build_on_outline(item: _PlacedSurrounding, site: Site) -> list[MeshPart]:
    declared = item.declaration
    return footprints.build_on_footprint(declared, site, item.random_key)


def _build_fields(item: _PlacedSurrounding, site: Site) -> Iterator[MeshPart]:
    build = _FIELD_BUILDERS[item.kind]
    free = item.limit_to_outline(site)
    for band in item.bands:
        yield from build(crops.sample_rows(band), item.height_m, free, item.random_key)


def _build_objects(item: _PlacedSurrounding, site: Site) -> Iterator[MeshPart]:
    """Build objects other than buildings, lamps, fields, plateaus and parked cars."""
    if build_at_point := _POINT_BUILDERS.get(item.kind):
        for point in item.sample_points():
            yield from build_at_point(point, item.height_m, site)
    elif build_along := _LINE_BUILDERS.get(item.kind):
        for line in item.find_lines(site.paved_area):
            yield from build_along(line, item.height_m, site, item.random_key)
    elif item.kind is SurroundingKind.TREES:
        yield from _build_trees(item, site)
    elif item.kind is SurroundingKind.WOODS:
        free = item.limit_to_outline(site)
        for band in item.bands:
            yield from woods.build_woods(band, item.height_m, free, item.random_key)
    elif item.kind is SurroundingKind.WATER:
        yield from roadside.build_water(item.declaration.line_m, site)
    elif item.kind is SurroundingKind.DRIVEWAY:
        for side in item.sides:
            yield from roadside.build_driveway(side, site)
    elif item.kind is SurroundingKind.PAVING:
        for side in item.sides:
            yield from roadside.build_paved_band(side, site)
    elif item.kind in _SIGN_KINDS:
        for side in item.sides:
            yield from _build_roadside_sign(item.declaration, side, site)
    elif item.kind is SurroundingKind.SKYLINE:
        for band in item.bands:
            yield from skyline.build_skyline(band, item.height_m, site, item.random_key)


def _build_trees(item: _PlacedSurrounding, site: Site) -> list[MeshPart]:
    margin = vegetation.ROW_CLEARANCE_M if item.is_row else vegetation.TRUNK_CLEARANCE_M
    places, species = item.scatter_trees(), item.declaration.species
    return vegetation.build_trees(
        places, item.height_m, site, item.random_key, species, clearance_m=margin
    )


def _build_roadside_sign(declared: Surrounding, side: StreetSide, site: Site) -> list[MeshPart]:
    foot = site.project_to_ground(side.points_at(0.0, side.near_offset_m))[0]
    if declared.sign is not None:
        return build_sign(declared.sign, foot, side.yaw(0.0))
    limit = declared.limit_km_h or KM_H_PER_M_S * side.street.speed_limit_m_s
    return build_speed_sign(limit, foot, side.yaw(0.0))

"""What stands beside a road, from its declared surroundings."""

from collections.abc import Iterator

import numpy as np
import shapely
from advercity_dsl import Road, RoadsideUnit
from advercity_dsl.road import Surrounding, SurroundingKind
from advercity_dsl.units import KM_H_PER_M_S
from shapely.geometry.base import BaseGeometry

from advercity.errors import InputError
from advercity.geometry.arrays import Float64Array
from advercity.geometry.mesh import Mesh, MeshPart, build_meshes
from advercity.roads.road_network import RoadNetwork
from advercity.scene import buildings, roadside, vegetation
from advercity.scene.buildings import HOUSE_LOTS, TOWN_LOTS, Lot
from advercity.scene.site import (
    GroundHeight,
    Site,
    StreetSide,
    rectangle_corners,
    resolve_street_sides,
    space_points_along,
)
from advercity.scene.street_furniture import build_speed_sign
from advercity.world import StreetLamp

SENSOR_CLEARANCE_M = 6.0
"""Around roadside units no trees grow and nothing is built."""
LINE_CLEARANCE_M = 0.2
"""Between paving and a fence, hedge or wall beside a street, which lets side streets through."""
_BUILDING_KINDS = (SurroundingKind.BUILDINGS, SurroundingKind.HOUSES)
_FIELD_KINDS = (SurroundingKind.CROPS, SurroundingKind.FIELD)
_LINEAR_KINDS = (SurroundingKind.WALL, SurroundingKind.FENCE, SurroundingKind.HEDGE)


def build_surroundings(
    network: RoadNetwork, ground_height: GroundHeight, keep_off: BaseGeometry
) -> tuple[list[Mesh], list[StreetLamp]]:
    """Meshes of the surroundings, one per material and class, and the lights among them.

    Buildings take their ground first, so that nothing grows into them.

    Args:
        network: The road; its id and the order of its surroundings key what is random.
        ground_height: World positions (n, 2) to heights (n,), metres.
        keep_off: Footprint of roadways and sidewalks, where nothing may grow or be built. Masts,
            walls and shelters stand where the declaration says.

    Raises:
        InputError: A declaration means a stretch that its street does not have.
    """
    road = network.declaration
    open_ground = Site(ground_height, keep_off, network.street_axes)
    site = open_ground.exclude(_find_sensor_clearances(road))
    places = [
        _PlacedSurrounding(network, number, item) for number, item in enumerate(road.surroundings)
    ]
    pieces: list[MeshPart] = []
    lamps: list[StreetLamp] = []
    for place in places:
        if place.declaration.kind in _BUILDING_KINDS:
            parts, taken = _build_buildings(place, site)
            pieces += parts
            site, open_ground = site.exclude(taken), open_ground.exclude(taken)
    for place in places:
        if place.declaration.kind is SurroundingKind.LAMP:
            for point in place.sample_points(roadside.LAMP_SPACING_M):
                parts, light = roadside.build_street_lamp(point, place.declaration.height_m, site)
                pieces += parts
                lamps.append(light)
        elif place.declaration.kind in _LINEAR_KINDS:
            for line in place.find_lines(keep_off):
                pieces += _build_line(place, line, site)
        elif place.declaration.kind in _FIELD_KINDS:
            pieces += _build_fields(place, open_ground)
        elif place.declaration.kind not in _BUILDING_KINDS:
            pieces += _build_pieces(place, site)
    return build_meshes(pieces, "surroundings_"), lamps


class _PlacedSurrounding:
    """A declaration with the sides of the street that it means."""

    def __init__(self, network: RoadNetwork, number: int, item: Surrounding) -> None:
        road = network.declaration
        self.declaration = item
        self.random_key = f"{road.id}/{number}/{item.seed}"
        self.sides: list[StreetSide] = []
        if item.beside:
            try:
                self.sides = resolve_street_sides(item.beside, network.streets)
            except InputError as error:
                raise InputError(f"road '{road.id}', surroundings.{number}: {error}") from error

    @property
    def is_row(self) -> bool:
        """Whether it says exactly where things stand, rather than over which ground."""
        return not self.declaration.area_m and all(
            side.near_offset_m == side.far_offset_m for side in self.sides
        )

    def sample_points(self, spacing_m: float) -> list[tuple[float, float]]:
        """Where single things stand."""
        spacing = self.declaration.spacing_m or spacing_m
        rows = [side.space_points(spacing, side.near_offset_m) for side in self.sides]
        rows.append(space_points_along(self.declaration.line_m, spacing))
        return [*self.declaration.at_m, *((float(x), float(y)) for x, y in np.concatenate(rows))]

    def scatter_trees(self) -> Float64Array:
        """(n, 2) points of trees."""
        spacing = self.declaration.spacing_m or vegetation.TREE_SPACING_M
        rows = [
            vegetation.scatter_points_along_street(side, spacing, self.random_key)
            for side in self.sides
        ]
        if self.declaration.area_m:
            rows.append(
                vegetation.scatter_points_in_area(self.declaration.area_m, spacing, self.random_key)
            )
        rows += [
            np.reshape(self.declaration.at_m, (-1, 2)),
            space_points_along(self.declaration.line_m, spacing),
        ]
        return np.concatenate(rows)

    def place_lots(self, plots: buildings.LotPattern) -> list[Lot]:
        """Where buildings may stand."""
        spacing = self.declaration.spacing_m
        rows = [
            buildings.place_lots_along_street(side, plots, spacing, self.random_key)
            for side in self.sides
        ]
        if self.declaration.area_m:
            rows.append(
                buildings.place_lots_in_area(
                    self.declaration.area_m, plots, spacing, self.random_key
                )
            )
        return [lot for row in rows for lot in row]

    def sample_field_rows(self) -> Iterator[Float64Array]:
        """Rows (n, m, 2) of each field."""
        for side in self.sides:
            yield vegetation.sample_rows_along_street(side)
        if self.declaration.area_m:
            yield vegetation.sample_rows_in_area(self.declaration.area_m)

    def sample_tree_tops(self) -> Iterator[Float64Array]:
        """Tops (n, m, 2) of the trees of each wood."""
        for side in self.sides:
            step = vegetation.compute_tree_top_spacing_m(
                side.length_m * (side.far_offset_m - side.near_offset_m)
            )
            yield vegetation.sample_rows_along_street(side, step, step)
        if self.declaration.area_m:
            low, high = rectangle_corners(self.declaration.area_m)
            step = vegetation.compute_tree_top_spacing_m(float(np.prod(high - low)))
            yield vegetation.sample_rows_in_area(self.declaration.area_m, step, step)

    def find_lines(self, paved: BaseGeometry) -> Iterator[tuple[tuple[float, float], ...]]:
        """Where walls, fences and hedges run; beside a street, not over what is paved."""
        if self.declaration.line_m:
            yield self.declaration.line_m
        for side in self.sides:
            points = side.offset_line(side.near_offset_m)
            if len(points) < 2:
                continue
            free = shapely.difference(
                shapely.LineString(points), shapely.buffer(paved, LINE_CLEARANCE_M)
            )
            for part in shapely.get_parts(free):
                if part.length > 1.0:
                    yield tuple((float(x), float(y)) for x, y in part.coords)


def _find_sensor_clearances(road: Road) -> list[BaseGeometry]:
    return [
        shapely.Point(agent.position_m[:2]).buffer(SENSOR_CLEARANCE_M)
        for agent in road.agents.values()
        if isinstance(agent, RoadsideUnit)
    ]


def _build_buildings(
    place: _PlacedSurrounding, site: Site
) -> tuple[list[MeshPart], list[shapely.Polygon]]:
    if place.declaration.kind is SurroundingKind.HOUSES:
        return buildings.build_houses(
            place.place_lots(HOUSE_LOTS), place.declaration.height_m, site, place.random_key
        )
    return buildings.build_town_blocks(
        place.place_lots(TOWN_LOTS), place.declaration.height_m, site, place.random_key
    )


def _build_line(
    place: _PlacedSurrounding, line: tuple[tuple[float, float], ...], site: Site
) -> list[MeshPart]:
    height = place.declaration.height_m
    match place.declaration.kind:
        case SurroundingKind.FENCE:
            return roadside.build_fence(line, height, site)
        case SurroundingKind.HEDGE:
            return roadside.build_hedge(line, height, site, place.random_key)
        case _:
            return roadside.build_wall(line, height, site)


def _build_fields(place: _PlacedSurrounding, site: Site) -> list[MeshPart]:
    height, key = place.declaration.height_m, place.random_key
    if place.declaration.kind is SurroundingKind.FIELD:
        groups = [
            vegetation.build_tilled_field(rows, site, key) for rows in place.sample_field_rows()
        ]
    else:
        groups = [
            vegetation.build_crops(rows, height, site, key) for rows in place.sample_field_rows()
        ]
    return [piece for pieces in groups for piece in pieces]


def _build_pieces(place: _PlacedSurrounding, site: Site) -> list[MeshPart]:
    item, key = place.declaration, place.random_key
    match item.kind:
        case SurroundingKind.TREES:
            margin = vegetation.ROW_CLEARANCE_M if place.is_row else vegetation.TRUNK_CLEARANCE_M
            return vegetation.build_trees(
                place.scatter_trees(), item.height_m, site, key, item.species, clearance_m=margin
            )
        case SurroundingKind.BUS_STOP:
            groups = [roadside.build_bus_stop(point, site) for point in item.at_m]
        case SurroundingKind.TOWER:
            groups = [roadside.build_tower(point, item.height_m, site) for point in item.at_m]
        case SurroundingKind.POLE:
            points = place.sample_points(roadside.LAMP_SPACING_M)
            groups = [roadside.build_pole(point, item.height_m, site) for point in points]
        case SurroundingKind.WOODS:
            groups = [
                vegetation.build_woods(tops, item.height_m, site, key)
                for tops in place.sample_tree_tops()
            ]
        case SurroundingKind.SPEED_SIGN:
            groups = [_build_speed_sign(item.limit_km_h, side, site) for side in place.sides]
        case SurroundingKind.DRIVEWAY:
            groups = [roadside.build_driveway(side, site) for side in place.sides]
        case _:
            groups = []
    return [piece for pieces in groups for piece in pieces]


def _build_speed_sign(limit_km_h: float | None, side: StreetSide, site: Site) -> list[MeshPart]:
    foot = site.project_to_ground(side.points_at(0.0, side.near_offset_m))[0]
    return build_speed_sign(
        limit_km_h or KM_H_PER_M_S * side.street.speed_limit_m_s, foot, side.yaw(0.0)
    )

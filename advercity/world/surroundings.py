"""What stands beside a road, from its declared surroundings."""

from collections.abc import Iterator

import numpy as np
import shapely
from advercity_dsl import Road, RoadsideUnit
from advercity_dsl.road import Surrounding, SurroundingKind
from shapely.geometry.base import BaseGeometry

from advercity.errors import InputError
from advercity.world import buildings, fields, roadside, trees, woods
from advercity.world.beside import Side, sides
from advercity.world.buildings import DETACHED, TOWN, Lot
from advercity.world.layout import layout
from advercity.world.roads import built
from advercity.world.scene import Mesh, StreetLamp
from advercity.world.shapes import Floats, Piece, meshes
from advercity.world.signs import speed_sign
from advercity.world.site import GroundHeight, Site, along, rectangle

SENSOR_CLEARANCE_M = 6.0
"""Around roadside units no trees grow and nothing is built."""
LINE_CLEARANCE_M = 0.2
"""Between paving and a fence, hedge or wall beside a street, which lets side streets through."""
_BUILT = (SurroundingKind.BUILDINGS, SurroundingKind.HOUSES)
_FIELDS = (SurroundingKind.CROPS, SurroundingKind.FIELD)
_LONG = (SurroundingKind.WALL, SurroundingKind.FENCE, SurroundingKind.HEDGE)


def surroundings(
    road: Road, ground_height: GroundHeight, keep_off: BaseGeometry
) -> tuple[list[Mesh], list[StreetLamp]]:
    """Meshes of the surroundings, one per material and class, and the lights among them.

    Buildings take their ground first, so that nothing grows into them.

    Args:
        road: The declaration; its id and the order of its surroundings key what is random.
        ground_height: World positions (n, 2) to heights (n,), metres.
        keep_off: Footprint of roadways and sidewalks, where nothing may grow or be built. Masts,
            walls and shelters stand where the declaration says.

    Raises:
        InputError: A declaration means a stretch that its street does not have.
    """
    open_ground = Site(ground_height, keep_off, built(road).axes)
    site = open_ground.without(_sensors(road))
    places = [_Place(road, number, item) for number, item in enumerate(road.surroundings)]
    pieces: list[Piece] = []
    lamps: list[StreetLamp] = []
    for place in places:
        if place.item.kind in _BUILT:
            parts, taken = _buildings(place, site)
            pieces += parts
            site, open_ground = site.without(taken), open_ground.without(taken)
    for place in places:
        if place.item.kind is SurroundingKind.LAMP:
            for point in place.points(roadside.LAMP_SPACING_M):
                parts, light = roadside.lamp(point, place.item.height_m, site)
                pieces += parts
                lamps.append(light)
        elif place.item.kind in _LONG:
            for line in place.lines(keep_off):
                pieces += _line(place, line, site)
        elif place.item.kind in _FIELDS:
            pieces += _fields(place, open_ground)
        elif place.item.kind not in _BUILT:
            pieces += _pieces(place, site)
    return meshes(pieces, "surroundings_"), lamps


class _Place:
    """A declaration with the sides of the street that it means."""

    def __init__(self, road: Road, number: int, item: Surrounding) -> None:
        self.item = item
        self.key = f"{road.id}/{number}/{item.seed}"
        self.sides: list[Side] = []
        if item.beside:
            try:
                self.sides = sides(item.beside, layout(road).streets)
            except InputError as error:
                raise InputError(f"road '{road.id}', surroundings.{number}: {error}") from error

    @property
    def is_row(self) -> bool:
        """Whether it says exactly where things stand, rather than over which ground."""
        return not self.item.area_m and all(side.near_m == side.far_m for side in self.sides)

    def points(self, spacing_m: float) -> list[tuple[float, float]]:
        """Where single things stand."""
        spacing = self.item.spacing_m or spacing_m
        rows = [side.spread(spacing, side.near_m) for side in self.sides]
        rows.append(along(self.item.line_m, spacing))
        return [*self.item.at_m, *((float(x), float(y)) for x, y in np.concatenate(rows))]

    def scattered(self) -> Floats:
        """(n, 2) points of trees."""
        spacing = self.item.spacing_m or trees.TREE_SPACING_M
        rows = [trees.scattered_beside(side, spacing, self.key) for side in self.sides]
        if self.item.area_m:
            rows.append(trees.scattered(self.item.area_m, spacing, self.key))
        rows += [np.reshape(self.item.at_m, (-1, 2)), along(self.item.line_m, spacing)]
        return np.concatenate(rows)

    def lots(self, plots: buildings.Plots) -> list[Lot]:
        """Where buildings may stand."""
        spacing = self.item.spacing_m
        rows = [buildings.lots_beside(side, plots, spacing, self.key) for side in self.sides]
        if self.item.area_m:
            rows.append(buildings.lots_over(self.item.area_m, plots, spacing, self.key))
        return [lot for row in rows for lot in row]

    def rows(self) -> Iterator[Floats]:
        """Rows (n, m, 2) of each field."""
        for side in self.sides:
            yield fields.rows_beside(side)
        if self.item.area_m:
            yield fields.rows_over(self.item.area_m)

    def tops(self) -> Iterator[Floats]:
        """Tops (n, m, 2) of the trees of each wood."""
        for side in self.sides:
            step = woods.step_m(side.length_m * (side.far_m - side.near_m))
            yield fields.rows_beside(side, step, step)
        if self.item.area_m:
            low, high = rectangle(self.item.area_m)
            step = woods.step_m(float(np.prod(high - low)))
            yield fields.rows_over(self.item.area_m, step, step)

    def lines(self, paved: BaseGeometry) -> Iterator[tuple[tuple[float, float], ...]]:
        """Where walls, fences and hedges run; beside a street, not over what is paved."""
        if self.item.line_m:
            yield self.item.line_m
        for side in self.sides:
            points = side.line(side.near_m)
            if len(points) < 2:
                continue
            free = shapely.difference(
                shapely.LineString(points), shapely.buffer(paved, LINE_CLEARANCE_M)
            )
            for part in shapely.get_parts(free):
                if part.length > 1.0:
                    yield tuple((float(x), float(y)) for x, y in part.coords)


def _sensors(road: Road) -> list[BaseGeometry]:
    return [
        shapely.Point(agent.position_m[:2]).buffer(SENSOR_CLEARANCE_M)
        for agent in road.agents.values()
        if isinstance(agent, RoadsideUnit)
    ]


def _buildings(place: _Place, site: Site) -> tuple[list[Piece], list[shapely.Polygon]]:
    if place.item.kind is SurroundingKind.HOUSES:
        return buildings.houses(place.lots(DETACHED), place.item.height_m, site, place.key)
    return buildings.buildings(place.lots(TOWN), place.item.height_m, site, place.key)


def _line(place: _Place, line: tuple[tuple[float, float], ...], site: Site) -> list[Piece]:
    height = place.item.height_m
    match place.item.kind:
        case SurroundingKind.FENCE:
            return roadside.fence(line, height, site)
        case SurroundingKind.HEDGE:
            return roadside.hedge(line, height, site, place.key)
        case _:
            return roadside.wall(line, height, site)


def _fields(place: _Place, site: Site) -> list[Piece]:
    height, key = place.item.height_m, place.key
    if place.item.kind is SurroundingKind.FIELD:
        groups = [fields.tilled_field(rows, site, key) for rows in place.rows()]
    else:
        groups = [fields.crops(rows, height, site, key) for rows in place.rows()]
    return [piece for pieces in groups for piece in pieces]


def _pieces(place: _Place, site: Site) -> list[Piece]:
    item, key = place.item, place.key
    match item.kind:
        case SurroundingKind.TREES:
            margin = trees.ROW_CLEARANCE_M if place.is_row else trees.TRUNK_CLEARANCE_M
            return trees.grown(
                place.scattered(), item.height_m, site, key, item.species, clearance_m=margin
            )
        case SurroundingKind.BUS_STOP:
            groups = [roadside.bus_stop(point, site) for point in item.at_m]
        case SurroundingKind.TOWER:
            groups = [roadside.tower(point, item.height_m, site) for point in item.at_m]
        case SurroundingKind.POLE:
            points = place.points(roadside.LAMP_SPACING_M)
            groups = [roadside.pole(point, item.height_m, site) for point in points]
        case SurroundingKind.WOODS:
            groups = [woods.woods(tops, item.height_m, site, key) for tops in place.tops()]
        case SurroundingKind.SPEED_SIGN:
            groups = [_speed_sign(item.limit_km_h, side, site) for side in place.sides]
        case SurroundingKind.DRIVEWAY:
            groups = [roadside.driveway(side, site) for side in place.sides]
        case _:
            groups = []
    return [piece for pieces in groups for piece in pieces]


def _speed_sign(limit_km_h: float | None, side: Side, site: Site) -> list[Piece]:
    foot = site.on_ground(side.at(0.0, side.near_m))[0]
    return speed_sign(limit_km_h or 3.6 * side.street.speed_limit_m_s, foot, side.yaw(0.0))

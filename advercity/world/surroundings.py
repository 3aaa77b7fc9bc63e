"""What stands beside a road, from its declared surroundings."""

import numpy as np
import shapely
from advercity_dsl import Road, RoadsideUnit
from advercity_dsl.road import Surrounding, SurroundingKind
from shapely.geometry.base import BaseGeometry

from advercity.errors import InputError
from advercity.world import buildings, plants, roadside
from advercity.world.roads import built
from advercity.world.scene import Mesh, StreetLamp
from advercity.world.shapes import Piece, meshes
from advercity.world.site import GroundHeight, Site, along

SENSOR_CLEARANCE_M = 6.0
"""Around roadside units nothing grows and nothing is built."""


def surroundings(
    road: Road, ground_height: GroundHeight, keep_off: BaseGeometry
) -> tuple[list[Mesh], list[StreetLamp]]:
    """Meshes of the surroundings, one per material and class, and the lights among them.

    Args:
        road: The declaration; its id and the order of its surroundings key what is random.
        ground_height: World positions (n, 2) to heights (n,), metres.
        keep_off: Footprint of roadways and sidewalks, where nothing may grow or be built. Masts,
            walls and shelters stand where the declaration says.
    """
    site = _site(road, ground_height, keep_off)
    pieces: list[Piece] = []
    lamps: list[StreetLamp] = []
    for number, item in enumerate(road.surroundings):
        if item.kind is SurroundingKind.LAMP:
            for point in _points(item, roadside.LAMP_SPACING_M):
                parts, light = roadside.lamp(point, item.height_m, site)
                pieces += parts
                lamps.append(light)
        else:
            pieces += _pieces(item, site, f"{road.id}/{number}")
    return meshes(pieces, "surroundings_"), lamps


def _site(road: Road, ground_height: GroundHeight, keep_off: BaseGeometry) -> Site:
    sensors = [
        shapely.Point(agent.position_m[:2]).buffer(SENSOR_CLEARANCE_M)
        for agent in road.agents.values()
        if isinstance(agent, RoadsideUnit)
    ]
    free = shapely.union_all([keep_off, *sensors])
    shapely.prepare(free)
    return Site(ground_height, free, built(road).axes)


def _points(item: Surrounding, spacing_m: float) -> list[tuple[float, float]]:
    on_line = along(item.line_m, item.spacing_m or spacing_m)
    return [*item.at_m, *((float(x), float(y)) for x, y in on_line)]


def _pieces(item: Surrounding, site: Site, key: str) -> list[Piece]:
    """Pieces of one declaration; each kind is made of what it can be: area, line or points."""
    pieces: list[Piece] = []
    match item.kind:
        case SurroundingKind.TREES:
            spacing = item.spacing_m or plants.TREE_SPACING_M
            points = np.reshape(_points(item, spacing), (-1, 2))
            if item.area_m:
                points = np.concatenate([points, plants.scattered(item.area_m, spacing, key)])
            pieces += plants.trees(points, item.height_m, site, key)
        case SurroundingKind.BUILDINGS if item.area_m:
            pieces += buildings.buildings(item.area_m, item.height_m, site, key)
        case SurroundingKind.HOUSES if item.area_m:
            pieces += buildings.houses(item.area_m, item.height_m, site, key)
        case SurroundingKind.CROPS if item.area_m:
            pieces += plants.crops(item.area_m, item.height_m, site, key)
        case SurroundingKind.WALL if item.line_m:
            pieces += roadside.wall(item.line_m, item.height_m, site)
        case SurroundingKind.BUS_STOP:
            for point in item.at_m:
                pieces += roadside.bus_stop(point, site)
        case SurroundingKind.TOWER:
            for point in item.at_m:
                pieces += roadside.tower(point, item.height_m, site)
        case SurroundingKind.POLE:
            for point in _points(item, roadside.LAMP_SPACING_M):
                pieces += roadside.pole(point, item.height_m, site)
        case _:
            needed = "line_m" if item.kind is SurroundingKind.WALL else "area_m"
            raise InputError(f"surroundings: {item.kind} of {key} has no {needed}; give it one")
    return pieces

"""Places of imported roads on the globe, and their shift to a local origin."""

from typing import Any, TypeVar

from advercity_dsl import MapNetwork, Road
from advercity_dsl.base import Model
from advercity_dsl.road import MapPlace
from advercity_dsl.units import Point2

from advercity.errors import InputError

MAX_ORIGIN_ERROR_DEG = 1e-5
"""About a metre."""
PLACE_FIELDS = ("spawn_m", "destination_m", "position_m", "area_m", "line_m", "at_m")
ModelT = TypeVar("ModelT", bound=Model)


def place_imported_road(road: Road, network: MapNetwork) -> Road:
    """Give a road the network of its map, the map's place on the globe, and its local origin.

    Raises:
        InputError: The road declares another place.
    """
    placed = road.model_copy(update={"imported": network})
    if network.offset_m != (0.0, 0.0):
        placed = _move_declared(placed, network.offset_m)
    if network.place is not None:
        placed = placed.model_copy(update=_complete_origin(road, network.place))
    return placed


def _complete_origin(road: Road, place: MapPlace) -> dict[str, float]:
    found = {
        "origin_lat_deg": place.latitude_deg,
        "origin_lon_deg": place.longitude_deg,
        "origin_alt_m": place.altitude_m,
        "origin_convergence_deg": place.convergence_deg,
    }
    declared = {name: getattr(road, name) for name in found if name in road.model_fields_set}
    for name in ("origin_lat_deg", "origin_lon_deg"):
        if abs(declared.get(name, found[name]) - found[name]) > MAX_ORIGIN_ERROR_DEG:
            raise InputError(
                f"its geoReference puts the origin at {place.latitude_deg:.6f},"
                f" {place.longitude_deg:.6f}, but `{name}` is {declared[name]:g}; leave out"
                " `origin_lat_deg` and `origin_lon_deg`, which the map gives"
            )
    return found | declared


def _move_declared(road: Road, origin_m: Point2) -> Road:
    return road.model_copy(
        update={
            "agents": {name: _move_model(item, origin_m) for name, item in road.agents.items()},
            "ego_routes": {
                name: _move_model(item, origin_m) for name, item in road.ego_routes.items()
            },
            "surroundings": tuple(_move_model(item, origin_m) for item in road.surroundings),
        }
    )


def _move_model(item: ModelT, origin_m: Point2) -> ModelT:
    places = {name: getattr(item, name, None) for name in PLACE_FIELDS}
    moved = {name: _move_place(place, origin_m) for name, place in places.items() if place}
    return item.model_copy(update=moved)


def _move_place(place: Any, origin_m: Point2) -> Any:
    """Move a point [east, north] or [east, north, up], or several."""
    if isinstance(place[0], tuple):
        return tuple(_move_place(point, origin_m) for point in place)
    east, north, *up = place
    # Sums of large numbers would carry their rounding errors into the spec.
    return (round(east - origin_m[0], 6), round(north - origin_m[1], 6), *up)

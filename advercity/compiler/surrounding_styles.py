"""Surroundings of every street of a road with a style: buildings, trees, masts, furniture."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from advercity_dsl import Road
from advercity_dsl.road import (
    FurnitureDensity,
    LampType,
    RoadsidePlacement,
    Surrounding,
    SurroundingKind,
)

from advercity.geometry.polyline import StationedPolyline
from advercity.roads.plan_frame import mirror_surrounding, to_plan_frame
from advercity.roads.road_network import build_road
from advercity.roads.routes import RoutePlanner
from advercity.roads.streets import StreetLayout

JUNCTION_MARGIN_M = 8.0
"""Free distance from the ends of a street."""
MIN_STREET_M = 30.0
"""Shorter streets, which lie between junctions, have no surroundings."""
MAST_OFFSET_M = 1.0
"""Distance of lamps, poles and furniture from the paving."""
MAST_CLEARANCE_M = 0.6
"""Distance of masts from the paving of other streets."""


@dataclass(frozen=True)
class _Style:
    """Surroundings of a street, as bands of offsets from its paving, and distances of masts.

    Furniture is in pieces per 100 m of a side.
    """

    bands: tuple[tuple[SurroundingKind, tuple[float, float], float | None], ...]
    mast: SurroundingKind
    mast_spacing_m: float
    furniture: FurnitureDensity | None = None
    lamp: LampType | None = None


STYLES = {
    "downtown": _Style(
        (
            (SurroundingKind.BUILDINGS, (4.0, 6.0), None),
            (SurroundingKind.PAVING, (0.0, 5.0), None),
            (SurroundingKind.TREES, (2.2, 2.6), 16.0),
        ),
        SurroundingKind.LAMP,
        28.0,
        FurnitureDensity(
            bench=2,
            bin=3,
            post_box=0.6,
            hydrant=1,
            cabinet=1.2,
            bicycle_stand=1,
            planter=2,
            hoarding=0.8,
            works=0.4,
        ),
    ),
    "residential": _Style(
        ((SurroundingKind.HOUSES, (5.0, 7.0), None), (SurroundingKind.TREES, (2.4, 4.0), 17.0)),
        SurroundingKind.LAMP,
        26.0,
        FurnitureDensity(bench=0.5, bin=1, post_box=0.4, hydrant=0.8, cabinet=1),
        "lantern",
    ),
    "industrial": _Style(
        (
            (SurroundingKind.BUILDINGS, (14.0, 18.0), None),
            (SurroundingKind.TREES, (4.0, 9.0), 40.0),
        ),
        SurroundingKind.POLE,
        42.0,
        FurnitureDensity(hydrant=0.8, cabinet=1, hoarding=1.5),
    ),
    "rural": _Style(((SurroundingKind.TREES, (6.0, 26.0), 16.0),), SurroundingKind.POLE, 50.0),
}


_GENERATED_AS = {SurroundingKind.HOUSES: SurroundingKind.BUILDINGS}
"""Kinds of a style that may take the place of a kind on the map."""


def grow_surroundings(road: Road, mapped: Sequence[Surrounding] = ()) -> Road:
    """Add the surroundings on the map of a road, and the other kinds of its style."""
    grown = list(mapped)
    if road.style is not None:
        style, plan = STYLES[road.style], to_plan_frame(road)
        known = {_GENERATED_AS.get(item.kind, item.kind) for item in mapped}
        generated = (
            *_iterate_bands(plan, style),
            *_iterate_masts(plan, style),
            *_iterate_furniture(plan, style),
        )
        if road.is_left_hand:
            generated = tuple(map(mirror_surrounding, generated))
        grown += [
            item for item in generated if _GENERATED_AS.get(item.kind, item.kind) not in known
        ]
    return road.model_copy(update={"style": None, "surroundings": (*road.surroundings, *grown)})


def _iterate_streets(road: Road) -> Iterator[StreetLayout]:
    streets = RoutePlanner(road).streets.values()
    yield from (street for street in streets if street.stations[-1] >= MIN_STREET_M)


def _place_beside(street: StreetLayout, offset_m: float | tuple[float, float]) -> RoadsidePlacement:
    return RoadsidePlacement(
        street=street.id,
        side="both",
        from_m=JUNCTION_MARGIN_M,
        to_m=round(float(street.stations[-1]) - JUNCTION_MARGIN_M, 2),
        offset_m=offset_m,
    )


def _iterate_furniture(road: Road, style: _Style) -> Iterator[Surrounding]:
    for street in _iterate_streets(road) if style.furniture else ():
        beside = _place_beside(street, MAST_OFFSET_M)
        yield Surrounding(kind=SurroundingKind.FURNITURE, beside=beside, per_100_m=style.furniture)


def _iterate_bands(road: Road, style: _Style) -> Iterator[Surrounding]:
    # Buildings of all streets first: trees must not take their ground.
    for kind, offset_m, spacing_m in style.bands:
        for street in _iterate_streets(road):
            beside = _place_beside(street, offset_m)
            yield Surrounding(kind=kind, beside=beside, spacing_m=spacing_m)


def _iterate_masts(road: Road, style: _Style) -> Iterator[Surrounding]:
    paving = build_road(road).paved_area
    shapely.prepare(paving)
    for street in _iterate_streets(road):
        left, right = (
            strips[-1].outer_t if strips else 0.0
            for strips in (street.left_strips, street.right_strips)
        )
        lines = street.offset_line(left + MAST_OFFSET_M), street.offset_line(right - MAST_OFFSET_M)
        for number, line in enumerate(lines):
            path = StationedPolyline.from_points(line[:, :2])
            first_m = JUNCTION_MARGIN_M + number * style.mast_spacing_m / 2
            stations = np.arange(first_m, path.length_m - JUNCTION_MARGIN_M, style.mast_spacing_m)
            points = path.points_at(stations).round(2)
            free = points[~shapely.dwithin(paving, shapely.points(points), MAST_CLEARANCE_M)]
            if len(free) > 0:
                at_m = tuple((float(east), float(north)) for east, north in free)
                yield Surrounding(kind=style.mast, at_m=at_m, lamp=style.lamp)

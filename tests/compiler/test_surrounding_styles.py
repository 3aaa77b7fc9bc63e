"""Surroundings that a road's style sets beside its streets."""

from pathlib import Path

import numpy as np
import pytest
import shapely
from advercity_dsl.road import SurroundingKind

from advercity.roads.road_network import build_road
from advercity.roads.routes import RoutePlanner
from tests.roads.imported_roads import CROSSROADS, compiled


@pytest.mark.parametrize(
    ("style", "building", "mast"),
    [("residential", "houses", "lamp"), ("rural", None, "pole")],
)
def test_a_style_sets_surroundings_beside_every_street(
    library: Path, tmp_path: Path, style: str, building: str | None, mast: str
):
    declared = {"kind": "trees", "at_m": [[50, 50]]}
    road = {**CROSSROADS, "style": style, "surroundings": [declared]}

    found = compiled(library, tmp_path, road).road

    assert found.surroundings[0].at_m == ((50.0, 50.0),)
    trees = {
        item.beside.street
        for item in found.surroundings
        if item.beside and item.kind is SurroundingKind.TREES
    }
    assert trees == {"grosse_strasse_1", "grosse_strasse_2", "road_12_1", "road_12_2"}
    assert any(item.kind == building for item in found.surroundings) == (building is not None)
    masts = [point for item in found.surroundings if item.kind == mast for point in item.at_m]
    assert len(masts) > 20
    gaps = shapely.distance(build_road(found).paved_area, shapely.points(masts))
    assert gaps.min() > 0.6


def test_lamps_alternate_between_the_sides_of_a_street_and_keep_off_its_ends(
    library: Path, tmp_path: Path
):
    """Residential lamps are 26 m apart on each side; nothing is set within 8 m of the ends."""
    road = compiled(library, tmp_path, {**CROSSROADS, "style": "residential"}).road
    lamps = shapely.points(
        [at for one in road.surroundings if one.kind == "lamp" for at in one.at_m]
    )
    streets = RoutePlanner(road).streets.values()
    centres = [shapely.LineString(one.offset_line(0.0)[:, :2]) for one in streets]  # straight
    nearest = np.argmin([shapely.distance(centre, lamps) for centre in centres], axis=0)
    for number, centre in enumerate(centres):
        own = lamps[nearest == number]
        stations_m = shapely.line_locate_point(centre, own)
        assert min(stations_m) == pytest.approx(8.0, abs=0.1)
        assert centre.length - max(stations_m) > 8.0
        is_left = shapely.distance(own, centre.parallel_offset(5.0, "left")) < 5.0
        from_left_m = stations_m[~is_left] - stations_m[is_left].min()
        assert from_left_m % 26.0 == pytest.approx(13.0, abs=0.2)


@pytest.mark.parametrize(
    ("style", "masts", "spacing_m", "bands", "furniture"),
    [
        (
            "downtown",
            "lamp",
            28.0,
            {"buildings": ((4, 6), None), "paving": ((0, 5), None), "trees": ((2.2, 2.6), 16)},
            {
                **{"bench": 2, "bin": 3, "post_box": 0.6, "hydrant": 1, "cabinet": 1.2},
                **{"bicycle_stand": 1, "planter": 2, "hoarding": 0.8, "works": 0.4},
            },
        ),
        (
            "residential",
            "lamp",
            26.0,
            {"houses": ((5, 7), None), "trees": ((2.4, 4), 17)},
            {"bench": 0.5, "bin": 1, "post_box": 0.4, "hydrant": 0.8, "cabinet": 1},
        ),
        (
            "industrial",
            "pole",
            42.0,
            {"buildings": ((14, 18), None), "trees": ((4, 9), 40)},
            {"hydrant": 0.8, "cabinet": 1, "hoarding": 1.5},
        ),
        ("rural", "pole", 50.0, {"trees": ((6, 26), 16)}, None),
    ],
)
def test_a_style_has_its_bands_masts_and_furniture(
    library: Path,
    tmp_path: Path,
    style: str,
    masts: str,
    spacing_m: float,
    bands: dict[str, tuple[tuple[float, float], float | None]],
    furniture: dict[str, float] | None,
):
    """Bands are metres from the paving and between trees, furniture is pieces per 100 m."""
    road = compiled(library, tmp_path, {**CROSSROADS, "style": style}).road
    found = {
        item.kind.value: (item.beside.offset_m, item.spacing_m)
        for item in road.surroundings
        if item.beside and item.kind is not SurroundingKind.FURNITURE
    }
    assert found == bands
    densities = [item.per_100_m for item in road.surroundings if item.per_100_m]
    assert len(densities) == (4 if furniture else 0)
    for density in densities:
        assert {name: value for name, value in density if value} == furniture
    types = {item.lamp for item in road.surroundings if item.kind == masts}
    assert types == {"lantern" if style == "residential" else None}
    rows = [item.at_m for item in road.surroundings if item.kind == masts]
    for row in rows:
        gaps_m = np.linalg.norm(np.diff(np.array(row), axis=0), axis=1)
        steps = gaps_m / spacing_m  # a mast is left out where another street is
        np.testing.assert_allclose(steps, steps.round(), atol=1e-3)
        assert steps.min() == pytest.approx(1.0, abs=1e-3)
    assert all(
        (item.beside.from_m, item.beside.side) == (8.0, "both")
        for item in road.surroundings
        if item.beside
    )

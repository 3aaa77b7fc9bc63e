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
    """Residential lamps are 34 m apart on each side; nothing is set within 8 m of the ends."""
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
        assert from_left_m % 34.0 == pytest.approx(17.0, abs=0.2)

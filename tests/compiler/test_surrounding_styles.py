"""Surroundings that a road's style sets beside its streets."""

from pathlib import Path

import pytest
import shapely
from advercity_dsl.road import SurroundingKind

from advercity.roads.road_network import build_road
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

"""What is between paving and open ground: bare soil and grass."""

import numpy as np
import pytest
import shapely
from advercity_dsl.road import Surrounding
from shapely.geometry.base import BaseGeometry

from advercity.geometry.mesh import Mesh, MeshPart
from advercity.roads.road_network import build_road
from advercity.scene.site import Site
from advercity.scene.surroundings import build_surroundings
from advercity.scene.verges import SPILL_M, build_street_plants, build_verges
from advercity.semantics import Semantic
from tests.scene.test_surroundings import PAVED, beside, sloping, street

GRASS = ("grass_blades", "straw")


def open_ground(*items: Surrounding) -> Site:
    return build_surroundings(build_road(street(*items)), sloping, PAVED)[2]


def verges(
    site: Site | None = None, roadway: BaseGeometry = PAVED, key: str = "test"
) -> dict[str, MeshPart]:
    parts = build_verges(roadway, site or open_ground(), key)
    return {part.material: part for part in parts}


def test_grass_grows_along_what_is_paved_and_thins_out_away_from_it():
    for material in GRASS:
        grass = verges()[material]
        assert grass.semantic is Semantic.TERRAIN
        feet = grass.surface.vertices[grass.surface.triangles[:, 0]]
        away = shapely.distance(PAVED, shapely.points(feet[:, :2]))
        assert np.percentile(away, 5) > 0.0
        assert away.max() < 3.3
        assert np.median(away) < 1.2
        assert np.abs(feet[:, 2] - sloping(feet[:, :2])).max() < 0.1


def test_blades_are_thin_and_no_higher_than_a_mown_verge_has_them():
    for material in GRASS:
        surface = verges()[material].surface
        corners = surface.vertices[surface.triangles]
        assert np.linalg.norm(corners[:, 0] - corners[:, 1], axis=1).max() < 0.015
        height = corners[:, 2, 2] - sloping(corners[:, 2])
        assert 0.03 < np.percentile(height, 5) < np.percentile(height, 95) < 0.25


def test_bare_ground_has_a_ragged_border_on_both_sides_and_no_gap_to_the_paving():
    ground = verges()["roadside_soil"]
    assert ground.semantic is Semantic.TERRAIN
    plane = ground.surface.vertices[:, :2]
    northern = plane[(plane[:, 1] > 4.0) & (np.abs(plane[:, 0]) < 95)]
    inner, outer = northern[northern[:, 1] <= 5.0], northern[northern[:, 1] > 5.0]
    assert inner[:, 1].min() >= 5.0 - SPILL_M - 1e-9
    assert inner[:, 1].std() > 0.01
    assert outer[:, 1].std() > 0.08
    assert outer[:, 1].max() < 6.2
    # Every tenth of a metre along the edge has bare ground on it.
    area = shapely.union_all(shapely.polygons(plane[ground.surface.triangles]))
    edge = np.column_stack([np.arange(-95, 95, 0.1), np.full(1900, 5.005)])
    assert shapely.intersects_xy(shapely.buffer(area, 0.01), edge[:, 0], edge[:, 1]).all()


def test_bare_ground_is_wide_where_wheels_come_and_narrow_beside_sidewalks():
    roadway, sidewalk = verges()["roadside_soil"], verges(roadway=shapely.box(0, 0, 0, 0))["soil"]
    widths = [
        np.abs(part.surface.vertices[:, 1]).max(initial=0.0) - 5.0 for part in (roadway, sidewalk)
    ]
    assert widths[0] > 2 * widths[1] > 0.1


def test_nothing_of_a_verge_is_on_drives_or_paving_of_its_own():
    item = beside("driveway", side="left", from_m=40, to_m=46, offset_m=(0, 8))
    drive = shapely.box(-60, 5.0, -54, 13)
    parts = verges(open_ground(item))
    for material in GRASS:
        surface = parts[material].surface
        feet = shapely.points(surface.vertices[surface.triangles[:, 0], :2])
        assert not shapely.intersects(shapely.buffer(drive, -0.1), feet).any()
    surface = parts["roadside_soil"].surface
    middles = surface.vertices[surface.triangles].mean(axis=1)[:, :2]
    assert not shapely.intersects(shapely.buffer(drive, -0.35), shapely.points(middles)).any()


def test_a_verge_depends_on_its_key_alone():
    first, again, other = verges(key="a"), verges(key="a"), verges(key="b")
    for material, part in first.items():
        assert part.surface.vertices.tobytes() == again[material].surface.vertices.tobytes()
    assert (
        first["roadside_soil"].surface.vertices.tobytes()
        != other["roadside_soil"].surface.vertices.tobytes()
    )


def flat(name: str, material: str, low: tuple[float, float], high: tuple[float, float]) -> Mesh:
    """A level rectangle at a height of 0.15 m."""
    (x0, y0), (x1, y1) = low, high
    corners = np.array([(x0, y0, 0.15), (x1, y0, 0.15), (x1, y1, 0.15), (x0, y1, 0.15)])
    triangles = np.array([(0, 1, 2), (0, 2, 3)], dtype=np.int32)
    return Mesh(name, corners.astype(np.float32), triangles, material, Semantic.TERRAIN)


def test_grass_of_a_median_hangs_over_its_kerbs_at_most():
    # A median 3 m wide between kerbs of 0.15 m.
    median = flat("median", "grass", (-40, -1.5), (40, 1.5))
    (grass,) = build_street_plants([median], shapely.box(-40, 1.65, 40, 8), "test")
    corners = grass.surface.vertices
    assert np.abs(corners[:, 1]).max() < 1.65
    # 80 m by 2.72 m with 26 tufts of 7 blades on each square metre.
    assert len(grass.surface.triangles) == pytest.approx(80 * 2.72 * 26 * 7, rel=0.05)
    assert 0.12 < corners[:, 2].min() < 0.14 < 0.2 < corners[:, 2].max() < 0.3


@pytest.mark.parametrize(("low", "high"), [((-40, -1.5), (40, 1.5)), ((20, -40), (23, 40))])
def test_grass_covers_a_median_whichever_way_it_runs(
    low: tuple[float, float], high: tuple[float, float]
):
    (grass,) = build_street_plants(
        [flat("median", "grass", low, high)], shapely.Point(0, 0), "test"
    )
    assert len(grass.surface.triangles) == pytest.approx(80 * 2.72 * 26 * 7, rel=0.05)
    corners = grass.surface.vertices[:, :2]
    assert (corners > np.array(low) - 0.15).all()
    assert (corners < np.array(high) + 0.15).all()


def test_weeds_grow_from_the_joint_behind_a_kerb():
    kerb = flat("kerb", "kerb", (-40, 5.0), (40, 5.15))
    (weeds,) = build_street_plants([kerb], shapely.box(-40, 0, 40, 5.0), "test")
    feet = weeds.surface.vertices[weeds.surface.triangles[:, :2]].mean(axis=1)
    assert 5.06 < feet[:, 1].min() < feet[:, 1].max() < 5.21
    assert 0.8 < len(feet) / 7 / 80 < 1.3
    assert weeds.surface.vertices[:, 1].min() > 4.95

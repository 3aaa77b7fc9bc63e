"""Road and ground meshes, felt out with rays from above."""

from collections.abc import Callable
from itertools import groupby
from pathlib import Path

import numpy as np
import pytest
import shapely
import yaml
from advercity_dsl import Road
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene
from numpy.typing import NDArray

from advercity.geometry import polyline
from advercity.geometry.mesh import Mesh
from advercity.materials import MATERIALS
from advercity.roads.layout import RoadLayout, lay_out_road
from advercity.roads.road_meshes import KERB_HEIGHT_M
from advercity.roads.road_network import AuthoredRoadNetwork
from advercity.scene import terrain
from advercity.semantics import Semantic

NAMES = ("ui", "unj", "ri", "rsnj", "rcnj")
ABOVE_M = 50.0

Site = tuple[RoadLayout, list[Mesh]]
Below = Callable[[NDArray[np.float64]], tuple[NDArray[np.float64], NDArray[np.int64]]]


@pytest.fixture(scope="module")
def sites(library: Path) -> dict[str, Site]:
    found: dict[str, Site] = {}
    for name in NAMES:
        text = (library / f"nhtsa/roads/{name}.yaml").read_text(encoding="utf-8")
        plan = lay_out_road(Road.model_validate(yaml.safe_load(text)))
        found[name] = plan, built_meshes(plan)
    return found


def built_meshes(plan: RoadLayout) -> list[Mesh]:
    """All that is seen of a road and the ground around it."""
    road = AuthoredRoadNetwork(plan)
    return [
        *road.meshes,
        terrain.build_skirt(road.paved_edges),
        terrain.build_ground(terrain.GroundModel.from_edges(road.paved_edges), road.paved_area),
    ]


def looking_down(meshes: list[Mesh]) -> Below:
    """From points (n, 2) to the height (n,) and class (n,) of what is seen there from above."""
    corners = np.concatenate([mesh.vertices[mesh.triangles] for mesh in meshes])
    classes = np.concatenate([np.full(len(m.triangles), m.semantic.value) for m in meshes])
    scene = EmbreeScene()
    TriangleMesh(scene, corners)

    def below(points: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
        starts = np.column_stack([points, np.full(len(points), ABOVE_M)]).astype(np.float32)
        down = np.tile(np.array([0, 0, -1], dtype=np.float32), (len(points), 1))
        hits = scene.run(starts, down, output=True)
        assert (hits["primID"] >= 0).all(), "a hole"
        return ABOVE_M - hits["tfar"], classes[hits["primID"]]

    return below


def along(line: polyline.Points) -> polyline.Points:
    """Points every half metre or so, which are not the line's own."""
    return polyline.resample_polyline(line, max(3, int(polyline.polyline_length(line) / 0.47)))[
        1:-1
    ]


@pytest.mark.parametrize("name", NAMES)
def test_roads_have_no_holes_and_lie_at_the_height_of_their_lanes(
    sites: dict[str, Site], name: str
) -> None:
    plan, meshes = sites[name]
    below = looking_down(meshes)
    lanes = [
        street.directed_line(t, along=band.outer_t < 0)
        for street in plan.streets.values()
        for band in (*street.left_strips, *street.right_strips)
        if band.lane_number
        for t in (band.centre_t, band.centre_t + 1.4, band.centre_t - 1.4)
    ]
    lanes += [
        path.centre for junction in plan.junctions.values() for path in junction.connecting_paths
    ]
    points = np.concatenate([along(lane) for lane in lanes])
    z, classes = below(points[:, :2])
    np.testing.assert_allclose(z, points[:, 2], atol=0.02)
    assert set(classes) <= {Semantic.ROAD, Semantic.ROAD_LINE}


@pytest.mark.parametrize("name", NAMES)
def test_sidewalks_and_medians_are_a_kerb_higher(sites: dict[str, Site], name: str) -> None:
    plan, meshes = sites[name]
    below = looking_down(meshes)
    expected = {"sidewalk": Semantic.SIDEWALK, "median": Semantic.TERRAIN}
    for street in plan.streets.values():
        for band in (*street.left_strips, *street.right_strips):
            if band.kind in expected:
                points = along(street.offset_line(band.centre_t))
                z, classes = below(points[:, :2])
                np.testing.assert_allclose(z, points[:, 2] + KERB_HEIGHT_M, atol=0.02)
                assert set(classes) == {expected[band.kind]}


def test_sidewalks_run_around_the_corners_of_a_crossing(sites: dict[str, Site]) -> None:
    plan, meshes = sites["ui"]
    below = looking_down(meshes)
    for corner in plan.junctions["j_main"].corners:
        assert corner.sidewalk_outer_edge is not None
        middle = along((corner.kerb + corner.sidewalk_outer_edge) / 2)
        z, classes = below(middle[:, :2])
        np.testing.assert_allclose(z, KERB_HEIGHT_M, atol=0.001)
        assert set(classes) == {Semantic.SIDEWALK}


@pytest.mark.parametrize("name", NAMES)
def test_the_ground_never_shows_through_the_road(sites: dict[str, Site], name: str) -> None:
    plan, meshes = sites[name]
    (ground,) = (mesh for mesh in meshes if mesh.name == "ground")
    inside = shapely.buffer(AuthoredRoadNetwork(plan).paved_area, -2 * terrain.OVERLAP_M)
    centres = ground.vertices[ground.triangles].mean(axis=1)
    assert not shapely.contains_xy(inside, centres[:, 0], centres[:, 1]).any()


@pytest.mark.parametrize("name", NAMES)
def test_the_ground_meets_the_road_and_extends_far_beyond_it(
    sites: dict[str, Site], name: str
) -> None:
    plan, meshes = sites[name]
    below = looking_down(meshes)
    for street in plan.streets.values():
        for bands, side in ((street.left_strips, 1), (street.right_strips, -1)):
            edge, beside = (street.offset_line(bands[-1].outer_t + side * d) for d in (0, 0.15))
            free = ~shapely.contains_xy(
                AuthoredRoadNetwork(plan).paved_area, beside[:, 0], beside[:, 1]
            )
            free &= (street.stations > 5) & (street.stations < street.stations[-1] - 5)
            if not free.any():
                continue
            z, classes = below(beside[free, :2])
            raised = KERB_HEIGHT_M * (bands[-1].kind == "sidewalk")
            np.testing.assert_allclose(z, edge[free, 2] + raised, atol=0.06)
            assert set(classes) == {Semantic.TERRAIN}
    x0, y0, x1, y1 = shapely.bounds(AuthoredRoadNetwork(plan).paved_area)
    corners = np.array([(x, y) for x in (x0 - 150, x1 + 150) for y in (y0 - 150, y1 + 150)])
    z, _ = below(corners)
    heights = np.concatenate([street.axis[:, 2] for street in plan.streets.values()])
    assert (z > heights.min() - 0.5).all() and (z < heights.max()).all()


def test_the_ground_follows_the_hill(sites: dict[str, Site]) -> None:
    """The roadside units of the hill road stand on a verge that is level with the road."""
    plan, meshes = sites["rcnj"]
    below = looking_down(meshes)
    beside = np.array([(46.97, 145.36), (52.58, 77.76)])
    z, _ = below(beside)
    np.testing.assert_allclose(z, (8.31, 5.51), atol=0.5)
    ground = terrain.GroundModel.from_edges(AuthoredRoadNetwork(plan).paved_edges)
    np.testing.assert_allclose(z, ground.height_at(beside), atol=0.15)


@pytest.mark.parametrize("name", NAMES)
def test_meshes_are_lean_and_face_upwards(sites: dict[str, Site], name: str) -> None:
    _, meshes = sites[name]
    assert sum(len(mesh.triangles) for mesh in meshes) < 60_000
    assert len({mesh.name for mesh in meshes}) == len(meshes)
    for mesh in meshes:
        assert mesh.material in MATERIALS
        assert np.isfinite(mesh.vertices).all()
        assert mesh.triangles.max() < len(mesh.vertices)
        a, b, c = (mesh.vertices[mesh.triangles[:, i]].astype(np.float64) for i in range(3))
        up = np.cross(b - a, c - a)[:, 2]
        assert (up > -1e-4).all(), mesh.name


def test_crossings_and_lines_are_painted(sites: dict[str, Site]) -> None:
    plan, meshes = sites["ui"]
    below = looking_down(meshes)
    junction = plan.junctions["j_main"]
    for crossing in junction.crossings:
        _, classes = below(polyline.resample_polyline(crossing.centre, 401)[:, :2])
        assert 0.4 < np.mean(classes == Semantic.ROAD_LINE) < 0.6
    street = plan.streets["north_road"]
    shares = {
        t: np.mean(below(along(street.offset_line(t))[:, :2])[1] == Semantic.ROAD_LINE)
        for t in (-2.25, -5.75, -5.2)
    }
    assert shares[-2.25] == 1.0
    assert shares[-5.75] == pytest.approx(0.25, abs=0.04)
    assert shares[-5.2] < 0.02


def test_lines_divide_parking_bays(sites: dict[str, Site]) -> None:
    """Along the middle of the bays of rsnj's village road, 3.73 m wide each."""
    plan, meshes = sites["rsnj"]
    street = plan.streets["parking_road_b"]
    (bays,) = (band for band in street.left_strips if band.bay_width_m)
    line = polyline.resample_polyline(street.offset_line(bays.centre_t), 5001)
    painted = looking_down(meshes)(line[:, :2])[1] == Semantic.ROAD_LINE
    edges = np.flatnonzero(np.diff(painted.astype(int)) == 1) * street.stations[-1] / 5000
    assert len(edges) == int(street.stations[-1] / 3.73) + 1
    np.testing.assert_allclose(np.diff(edges), 3.73, atol=0.02)


def test_arrows_point_where_a_lane_leads(sites: dict[str, Site]) -> None:
    """The right-turn lane of ri has two, 4 m and 13.4 m before the crossing."""
    plan, meshes = sites["ri"]
    below = looking_down(meshes)
    street = plan.streets["east_road_a"]
    lane = street.find_lane(2, along=True)
    painted = {
        t: below(polyline.resample_polyline(street.offset_line(lane.centre_t + t), 3001)[:, :2])[1]
        == Semantic.ROAD_LINE
        for t in (-0.5, 0.0, 0.5)
    }
    starts = np.flatnonzero(np.diff(painted[0.0].astype(int)) == 1) * street.stations[-1] / 3000
    np.testing.assert_allclose(street.stations[-1] - starts[:2], (14.9, 5.5), atol=0.05)
    stop_line = street.stations[-1] - 1.0
    before = np.linspace(0, street.stations[-1], 3001) < stop_line
    assert painted[-0.5][before].any(), "the head is on the right"
    assert not painted[0.5][before].any()


@pytest.mark.parametrize("name", NAMES)
def test_kerbs_are_closed(sites: dict[str, Site], name: str) -> None:
    """A ray along the road that comes down on a kerb from the roadway meets its upright face."""
    plan, meshes = sites[name]
    scene = EmbreeScene()
    faces = [mesh for mesh in meshes if mesh.name != "ground"]
    TriangleMesh(scene, np.concatenate([mesh.vertices[mesh.triangles] for mesh in faces]))
    classes = np.concatenate([np.full(len(m.triangles), m.semantic.value) for m in faces])
    for street in plan.streets.values():
        for bands, outward in ((street.left_strips, 1), (street.right_strips, -1)):
            for band in bands:
                if band.kind != "sidewalk":
                    continue
                foot = along(street.offset_line(band.inner_t))
                ahead = np.gradient(foot[:, :2], axis=0)
                across = polyline.left_normals(ahead / np.linalg.norm(ahead, axis=1, keepdims=True))
                rays = np.column_stack([outward * across, np.zeros(len(foot))])
                for height in (0.02, 0.08, 0.13):
                    starts = foot + np.array([0, 0, height]) - 0.3 * rays
                    hits = scene.run(
                        starts.astype(np.float32), rays.astype(np.float32), output=True
                    )
                    np.testing.assert_allclose(hits["tfar"], 0.3, atol=0.03)
                    assert set(classes[hits["primID"]]) == {Semantic.SIDEWALK}


@pytest.mark.parametrize("name", NAMES)
def test_paint_lies_above_the_road_by_more_than_depth_can_miss(
    sites: dict[str, Site], name: str
) -> None:
    """Every triangle of paint, at its corners and middle: by 4 mm at least, and not 2 cm."""
    _, meshes = sites[name]
    beneath = (mesh for mesh in meshes if mesh.semantic is not Semantic.ROAD_LINE)
    below = looking_down([mesh for mesh in beneath if mesh.name != "ground"])
    for mesh in meshes:
        if mesh.semantic is Semantic.ROAD_LINE:
            corners = mesh.vertices[mesh.triangles].astype(np.float64)
            middle = corners.mean(axis=1, keepdims=True)
            points = np.concatenate([middle, 0.98 * corners + 0.02 * middle], axis=1).reshape(-1, 3)
            lift = points[:, 2] - below(points[:, :2])[0]
            assert lift.min() > 0.004, points[lift.argmin()]
            assert lift.max() < 0.02, points[lift.argmax()]


def test_traffic_stops_at_a_bar_and_gives_way_at_blocks(sites: dict[str, Site]) -> None:
    """Across the arriving lane of rsnj's farm lane (stop) and of its village road (give way)."""
    plan, meshes = sites["rsnj"]
    below = looking_down(meshes)

    def painted(street: str, *, at_end: bool) -> list[bool]:
        axis = plan.streets[street]
        across = np.linspace(0.15, 2.95, 281) * (-1 if at_end else 1)
        points = np.stack([axis.offset_line(t)[-1 if at_end else 0, :2] for t in across])
        ahead = np.diff(axis.axis[-2:] if at_end else axis.axis[:2], axis=0)[0, :2]
        inwards = -1 if at_end else 1
        middle = points + 0.4 * inwards * ahead / np.linalg.norm(ahead)
        classes = below(middle)[1] == Semantic.ROAD_LINE
        return [bool(value) for value, _ in groupby(classes)]

    assert painted("east_lane", at_end=False) == [True]
    blocks = painted("parking_road_a", at_end=True)
    assert blocks.count(True) in (4, 5)


def test_the_same_road_gives_the_same_meshes(sites: dict[str, Site]) -> None:
    plan, meshes = sites["ri"]
    for first, again in zip(meshes, built_meshes(plan), strict=True):
        assert first.name == again.name
        np.testing.assert_array_equal(first.vertices, again.vertices)
        np.testing.assert_array_equal(first.triangles, again.triangles)


def test_ground_as_near_to_two_edges_keeps_its_height_when_a_place_is_rounded_otherwise():
    edges = [np.array([[-50.0, y, z], [50.0, y, z]]) for y, z in ((-7.0, 0.0), (7.0, 0.15))]
    ground = terrain.GroundModel.from_edges(edges)
    places = np.array([[0.0, 0.0], [0.0, 1e-13], [0.0, -1e-13]])
    heights = ground.height_at(places)
    assert np.ptp(heights) < 1e-9

"""Nothing is in the way of vehicles on roads that are imported from maps.

With ADVERCITY_MAPS naming a folder of OpenDRIVE and OpenStreetMap files, all of them are searched:
`ADVERCITY_MAPS=~/maps pytest -m slow tests/roads/test_imported_obstacles.py`.
"""

import os
from collections.abc import Iterator
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from advercity_dsl import MapFile, Road, Spec
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene

from advercity.compiler.map_surroundings import read_surroundings
from advercity.compiler.surrounding_styles import grow_surroundings
from advercity.geometry.polyline import resample_polyline
from advercity.roads.map_import import import_map
from advercity.roads.road_network import RoadNetwork, build_road
from advercity.scene.street_furniture import build_street_furniture
from advercity.scene.surroundings import build_surroundings
from advercity.scene.terrain import GroundModel
from tests.roads.imported_roads import declaration
from tests.roads.probing import Floats

MAPS = os.environ.get("ADVERCITY_MAPS")
HEIGHTS_M = (0.3, 1.0, 2.0, 3.5)
EDGE_MARGIN_M = 0.25
OFFSET_STEP_M = 0.15
STEP_M = 2.0


def load_map(path: Path, style: str) -> Road:
    """Import a map around its middle, without agents, with what a style adds along its streets."""
    source = {".osm": "osm", ".xodr": "opendrive"}[path.suffix]
    data = declaration(source, path.name, style=style)
    if source == "osm":
        nodes = ElementTree.parse(path).getroot().iter("node")
        places = np.array(
            [(float(node.attrib["lat"]), float(node.attrib["lon"])) for node in nodes]
        )
        data["origin_lat_deg"], data["origin_lon_deg"] = places.mean(axis=0).tolist()
    road = Road.model_validate(data)
    declared = road.imported
    assert isinstance(declared, MapFile)
    road = road.model_copy(update={"imported": import_map(declared, road, path.parent)})
    return grow_surroundings(road, read_surroundings(declared, road, path.parent))


def find_obstacles(road: RoadNetwork) -> Iterator[str]:
    """Drive rays along every driving lane, over its whole width and at several heights."""
    ground = GroundModel.from_edges(road.paved_edges, [])
    furniture, _ = build_street_furniture(road, ground.height_at)
    surroundings, *_ = build_surroundings(road, ground.height_at, road.paved_area)
    meshes = [*road.meshes, *furniture, *surroundings]
    scene = EmbreeScene()
    TriangleMesh(scene, np.concatenate([mesh.vertices[mesh.triangles] for mesh in meshes]))
    for lane in road.lanes:
        if lane.kind != "driving":
            continue
        starts, ends = _rays_along(lane.left, lane.right)
        steps = ends - starts
        lengths = np.linalg.norm(steps, axis=1)
        hits = scene.run(
            starts.astype(np.float32),
            (steps / lengths[:, None]).astype(np.float32),
            output=True,
        )
        met = (hits["primID"] >= 0) & (hits["tfar"] < lengths)
        if met.any():
            at = (starts + steps * (hits["tfar"] / lengths)[:, None])[met][0].round(1)
            yield f"{lane.id} at {at.tolist()}: {int(met.sum())} rays"


def _rays_along(left: Floats, right: Floats) -> tuple[Floats, Floats]:
    count = max(2, int(np.linalg.norm(np.diff(left, axis=0), axis=1).sum() / STEP_M))
    left, right = resample_polyline(left, count), resample_polyline(right, count)
    width_m = float(np.linalg.norm(left - right, axis=1).max())
    margin = EDGE_MARGIN_M / width_m
    across = np.arange(margin, 1 - margin, OFFSET_STEP_M / width_m)[:, None, None]
    lines = left + across * (right - left)
    raised = np.concatenate([lines + np.array([0, 0, height]) for height in HEIGHTS_M])
    return raised[:, :-1].reshape(-1, 3), raised[:, 1:].reshape(-1, 3)


@pytest.mark.parametrize(
    ("name", "style"),
    [("bend", "rural"), ("crossroads", "downtown"), ("reimported", None)],
)
def test_nothing_is_in_a_driving_lane(
    name: str, style: str | None, request: pytest.FixtureRequest
) -> None:
    spec: Spec = request.getfixturevalue(name)
    bare = spec.road.model_copy(update={"agents": {}, "style": style})

    assert list(find_obstacles(build_road(grow_surroundings(bare)))) == []


@pytest.mark.slow
@pytest.mark.parametrize("style", ["downtown", "industrial"])
@pytest.mark.skipif(MAPS is None, reason="ADVERCITY_MAPS does not name a folder of maps")
def test_nothing_is_in_a_driving_lane_of_any_map_of_a_folder(style: str) -> None:
    paths = [path for path in Path(str(MAPS)).iterdir() if path.suffix in (".osm", ".xodr")]

    found = {path.name: list(find_obstacles(build_road(load_map(path, style)))) for path in paths}

    assert found == {path.name: [] for path in paths}

"""Traffic on roads that are imported from maps."""

import os
import shutil
from pathlib import Path

import numpy as np
import pytest
import shapely
from advercity_dsl import Spec, Vehicle

from advercity.compiler.crossing import compile_library
from advercity.errors import InputError
from advercity.frames import Trace
from advercity.roads.road_network import build_road
from advercity.roads.sumo_network import write_sumo_network
from advercity.semantics import Semantic
from advercity.traffic.simulation import simulate_in_subprocess
from tests.roads.imported_roads import CROSSROADS, DATA, compiled
from tests.roads.probing import Floats, looking_down, on_lane, road_meshes

HINT = "CARLA's Town07 is not tested; ADVERCITY_TOWN07 names its OpenDRIVE file"
TOWN07 = os.environ.get("ADVERCITY_TOWN07")


def positions(trace: Trace, number: int) -> Floats:
    index = next(at for at, actor in enumerate(trace.actors) if actor.id == number)
    rows = trace.states[trace.states["actor"] == index]
    return np.column_stack([rows["x"], rows["y"], rows["z"], rows["speed"], rows["tick"]])


def test_pedestrians_that_have_no_sidewalk_are_reported(
    library: Path, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    text = (DATA / "crossroads.osm").read_text(encoding="utf-8")
    (tmp_path / "bare.osm").write_text(text.replace('v="both"', 'v="no"'), encoding="utf-8")
    compiled(library, tmp_path, CROSSROADS | {"imported": {"source": "osm", "file": "bare.osm"}})
    assert "imported: has no pedestrians, since none of its streets has a sidewalk" in caplog.text


@pytest.mark.sumo
@pytest.mark.parametrize("name", ["bend", "crossroads", "reimported"])
def test_connected_vehicles_drive_to_their_destinations(
    name: str, request: pytest.FixtureRequest, tmp_path: Path
) -> None:
    spec: Spec = request.getfixturevalue(name)
    trace = simulate_in_subprocess(spec, write_sumo_network(spec.road, tmp_path))
    gaps: list[float] = []
    for agent in spec.agents:
        if isinstance(agent.place, Vehicle):
            rows = positions(trace, agent.number)
            assert (np.diff(rows[:, 4]) == 1).all()
            steps = np.linalg.norm(np.diff(rows[:, :2], axis=0), axis=1)
            assert (steps <= 1.3 * rows[1:, 3] * trace.tick_s + 0.12).all()
            gaps.append(float(np.abs(rows[-1, :2] - agent.place.destination_m).max()))
    assert len(trace) < 800
    assert min(gaps) < 12


@pytest.mark.sumo
def test_the_shortest_route_is_the_declared_one(
    authored: Spec, reimported: Spec, tmp_path: Path
) -> None:
    """The ego's route over the re-imported network follows the streets of the authored one."""
    first, second = (
        simulate_in_subprocess(spec, write_sumo_network(spec.road, tmp_path / name))
        for name, spec in (("authored", authored), ("imported", reimported))
    )

    declared, found = (
        shapely.LineString(positions(trace, 101)[:, :2]) for trace in (first, second)
    )
    longer, shorter = sorted((declared, found), key=lambda line: -line.length)
    assert shorter.length > 60
    assert max(longer.distance(shapely.Point(place)) for place in shorter.coords) < 2


@pytest.mark.sumo
def test_a_destination_that_no_route_leads_to_is_bad_input(bend: Spec, tmp_path: Path) -> None:
    elsewhere = {"route": (), "destination_m": (500.0, 500.0)}
    agents = tuple(
        agent.model_copy(update={"place": agent.place.model_copy(update=elsewhere)})
        for agent in bend.agents
    )

    with pytest.raises(InputError, match="no route leads from lane"):
        simulate_in_subprocess(
            bend.model_copy(update={"agents": agents}), write_sumo_network(bend.road, tmp_path)
        )


@pytest.mark.sumo
@pytest.mark.skipif(TOWN07 is None, reason=HINT)
def test_town07_builds_and_is_driven(library: Path, tmp_path: Path) -> None:
    example = library.parent / "examples" / "town07"
    shutil.copytree(example, tmp_path / "town07")
    shutil.copy(str(TOWN07), tmp_path / "town07" / "Town07.xodr")
    specs = compile_library(library, tmp_path / "town07", suite="town07")
    spec = next(spec for spec in specs if spec.id == "town07_ltap_od_ego_turns_clear_day_sparse")
    below = looking_down(road_meshes(spec, tmp_path))

    for lane in build_road(spec.road).lanes:
        if lane.kind == "driving" and not lane.in_junction:
            points = on_lane(lane)
            z, found = below(points)
            assert np.isin(found, (Semantic.ROAD.value, Semantic.ROAD_LINE.value)).mean() > 0.97
            assert np.quantile(np.abs(z - points[:, 2]), 0.97) < 0.02, lane.id
    trace = simulate_in_subprocess(spec, write_sumo_network(spec.road, tmp_path))
    assert len(trace) > 100

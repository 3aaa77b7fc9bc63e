"""Commands that import recorded traffic make specs that every other command takes."""

import shutil
from pathlib import Path

import numpy as np
import pytest
import yaml
from advercity_dsl import MapNetwork, TrajectorySet

from advercity.compiler import read_spec
from advercity.compiler.shipped_library import find_shipped_library
from advercity.frames import Trace
from advercity.recordings.recorded_tables import read_recording
from advercity.recordings.track_file import unpack_tracks
from tests.command_line import Command
from tests.recordings.recorded_files import (
    write_ind,
    write_interaction,
    write_openscenario,
    write_street,
)
from tests.roads.imported_roads import DATA
from tests.roads.lanelet2_maps import LaneletMap
from tests.roads.sumo_networks import build_crossing_network
from tests.traffic.sumo_scenario_files import write_sumo_scenario

SHIPPED = find_shipped_library()


def test_a_table_drives_on_the_lanelet2_map_that_it_comes_with(
    advercity: Command, tmp_path: Path
) -> None:
    lanelets = LaneletMap()
    middle, *edges = (lanelets.way([(-50.0, y), (250.0, y)]) for y in (0.0, 4.0, -4.0))
    for edge in edges:
        lanelets.lanelet(middle, edge, (), subtype="road")
    (tmp_path / "street.osm").write_text(lanelets.write())

    ran = advercity(
        *("import", "trajectories", write_interaction(tmp_path), "--map", tmp_path / "street.osm"),
        *("--ego", "1", "--name", "hill", "--looks", "shaped", "--output", tmp_path / "out"),
    )

    assert ran.code == 0, ran.err
    road = yaml.safe_load((tmp_path / "out/road.yaml").read_text())
    assert road["imported"]["source"] == "lanelet2"


def test_a_table_becomes_specs_that_are_run_and_verified(
    advercity: Command, tmp_path: Path
) -> None:
    out = tmp_path / "hill"
    ran = advercity(
        *("import", "trajectories", write_interaction(tmp_path), "--map", write_street(tmp_path)),
        *("--ego", "1", "--connected-count", "1", "--name", "hill", "--looks", "shaped"),
        *("--weather", "clear_day", "--weather", "fog_day", "--output", out),
    )
    specs = ran.out.split()
    assert ran.code == 0
    assert [Path(path).name for path in specs] == [
        "hill_clear_day_sparse.json",
        "hill_fog_day_sparse.json",
    ]
    assert "cav1 is 1, cav2 is 3" in ran.err
    assert advercity("validate", *specs).code == 0
    assert "recorded, 0 to 4 s: 3 vehicles, 1 on foot" in advercity("show", specs[0]).out
    assert advercity("simulate", *specs, "--no-video", "--output", tmp_path / "sim").code == 0
    data = tmp_path / "data"
    ran = advercity(
        *("run", *specs, "--frames", "10:12", "--backend", "fake", "--profile", "preview"),
        *("--scale", "0.05", "--output", data),
    )
    assert ran.code == 0, ran.err
    assert advercity("verify", data).code == 0
    clear, fog = (
        yaml.safe_load((data / name / "+101" / "000011.yaml").read_text())["vehicles"]
        for name in ("hill_clear_day_sparse", "hill_fog_day_sparse")
    )
    places = {number: vehicle["location"] for number, vehicle in clear.items()}
    assert places == {number: vehicle["location"] for number, vehicle in fog.items()}
    # A second into the recording, the oncoming car is at x = 152; CARLA's y is to the right.
    assert places[1001][:2] == pytest.approx([152.0, -1.75], abs=1e-4)


def test_a_scenario_is_imported_with_the_map_that_it_names(
    advercity: Command, tmp_path: Path
) -> None:
    path = write_openscenario(tmp_path)
    options = ("--looks", "shaped", "--output", tmp_path / "out")
    ran = advercity("import", "openscenario", path, *options)
    assert ran.code == 2
    assert f"{tmp_path / 'hill.xodr'}: there is no such map, which {path} names" in ran.err
    write_street(tmp_path)

    ran = advercity("import", "openscenario", path, *options)

    assert ran.code == 0, ran.err
    assert "cav1 is Ego, cav2 is Truck, cav3 is Other" in ran.err
    (spec,) = ran.out.split()
    ran = advercity("simulate", spec, "--no-video", "--output", tmp_path / "sim")
    assert ran.code == 0
    _, ego = Trace.load(tmp_path / "sim" / Path(spec).stem / "trace.npz").get_track(101)
    assert ego["x"][[0, 30, 50]] == pytest.approx([50, 72, 98], abs=1e-3)


def test_the_same_import_again_changes_nothing(advercity: Command, tmp_path: Path) -> None:
    command = (
        *("import", "trajectories", write_ind(tmp_path), "--map", write_street(tmp_path)),
        *("--ego", "1", "--looks", "shaped", "--output", tmp_path / "out"),
    )
    advercity(*command)
    ran = advercity(*command)
    assert (ran.code, "1 unchanged" in ran.err) == (0, True)
    assert "road 'recorded_07_tracks'" in ran.err


def test_nothing_is_written_where_a_spec_of_the_user_would_be_replaced(
    advercity: Command, tmp_path: Path
) -> None:
    mine = tmp_path / "out" / "specs" / "recorded_07_tracks_clear_day_sparse.json"
    mine.parent.mkdir(parents=True)
    mine.write_text("mine")
    ran = advercity(
        *("import", "trajectories", write_ind(tmp_path), "--map", write_street(tmp_path)),
        *("--ego", "1", "--looks", "shaped", "--output", tmp_path / "out"),
    )
    assert (ran.code, f"{mine}: is not as it was compiled" in ran.err) == (2, True)
    assert [path.name for path in (tmp_path / "out").iterdir()] == ["specs"]
    assert mine.read_text() == "mine"


@pytest.mark.parametrize(
    ("options", "expected"),
    {
        (): "choose the ego among 3 vehicles with --ego; recorded longest: 1 (car, 0.0 to 4.0 s)",
        ("--ego", "11"): "--ego 11: no such track; did you mean '1'?",
        ("--ego", "4"): "--ego 4: is a pedestrian; connected vehicles are car, van, truck",
        ("--ego", "1", "--to", "9"): "the ego '1' was recorded from 0 to 4 s; stay within that",
        ("--ego", "1", "--connected", "4"): "--connected 4: is a pedestrian",
        ("--ego", "1", "--offset", "0", "500"): "vehicles are 496 m from the lanes of the map",
        ("--ego", "1", "--name", "Hill 1"): "--name Hill 1: is not an id",
        ("--ego", "1", "--weather", "fogg_day"): "unknown weather 'fogg_day'; did you mean",
        ("--ego", "1", "--rig", "nothing"): "--rig: unknown rig 'nothing'",
        ("--weather", "../../x"): "--weather: unknown weather '../../x'; ",
        ("--origin", "91", "500"): "--origin 91 500: latitudes are -89 to 89 degrees",
        ("--origin", "nan", "0"): "--origin nan 0: latitudes are",
        ("--offset", "nan", "0"): "--offset nan 0: give metres, at most 10,000 km",
        ("--offset", "9999999", "0"): "leads farther than 10,000 km from the map's origin",
        ("--turn", "inf"): "--turn inf: give degrees, -360 to 360",
        ("--ego", "1", "--to", "0.0000001"): "--from 0, --to 1e-07: a scenario takes 0.1 s to",
    }.items(),
)
def test_a_choice_that_the_recording_does_not_have_is_bad_input(
    options: tuple[str, ...], expected: str, advercity: Command, tmp_path: Path
) -> None:
    ran = advercity(
        *("import", "trajectories", write_ind(tmp_path), "--map", write_street(tmp_path)),
        *(*options, "--looks", "shaped", "--output", tmp_path / "out"),
    )
    assert ran.code == 2
    assert expected in ran.err
    assert ".partial" not in ran.err
    assert "Warning" not in ran.err
    assert not (tmp_path / "out").exists()


def test_without_a_map_nothing_can_be_replayed(advercity: Command, tmp_path: Path) -> None:
    path = write_ind(tmp_path)
    ran = advercity("import", "trajectories", path, "--ego", "1", "--output", tmp_path / "out")
    assert (ran.code, "--map" in ran.err) == (2, True)
    wrong = ("--map", path, "--ego", "1", "--output", tmp_path / "out")
    ran = advercity("import", "trajectories", path, *wrong)
    assert (ran.code, "name it *.xodr (OpenDRIVE), *.osm or *.net.xml" in ran.err) == (2, True)


def test_an_unusable_map_is_reported_under_its_own_name(advercity: Command, tmp_path: Path) -> None:
    street = write_street(tmp_path)
    street.write_text(street.read_text().replace('a="3.5"', 'a="nan"'))
    chosen = ("--map", street, "--ego", "1", "--looks", "shaped", "--output", tmp_path / "out")

    ran = advercity("import", "trajectories", write_ind(tmp_path), *chosen)

    assert ran.code == 2
    assert f"error: {street}: line 8: <width>: a is 'nan'" in ran.err
    assert ".partial" not in ran.err
    assert not (tmp_path / "out").exists()


def test_what_an_author_changes_in_a_recorded_road_is_checked_by_place(
    advercity: Command, library: Path, tmp_path: Path
) -> None:
    out = tmp_path / "out"
    advercity(
        *("import", "trajectories", write_ind(tmp_path), "--map", write_street(tmp_path)),
        *("--ego", "1", "--name", "hill", "--looks", "shaped", "--output", out),
    )
    road, suite = out / "road.yaml", out / "suite.yaml"
    written, written_suite = road.read_text(), suite.read_text()

    def compile_with(old: str, new: str, path: Path = road) -> str:
        road.write_text(written)
        suite.write_text(written_suite)
        assert old in path.read_text()
        path.write_text(path.read_text().replace(old, new))
        ran = advercity("compile", library, out, "--suite", "hill", "--output", tmp_path / "specs")
        assert ran.code == 2
        return ran.err

    assert "agents.cav1.track: unknown track '71'" in compile_with("track: '1'", "track: '71'")
    assert "track '1' was recorded from 0 to 4 s, not from 0 to 6 s" in compile_with(
        "to_s: 4.0", "to_s: 6.0"
    )
    assert "'cav1' follows track '1', too" in compile_with("track: '2'", "track: '1'")
    assert "no traffic is simulated where 'trajectories' are given; write 0" in compile_with(
        "walkers: 0", "walkers: 3"
    )
    assert "require each other; give both or neither" in compile_with("    track: '1'\n", "")
    assert "which stage no conflict" in compile_with(
        "densities:", "cross_conflicts: [ltap_od_ego_turns]\ndensities:", suite
    )
    (out / "trajectories.csv").write_text((out / "trajectories.csv").read_text() + "\n")
    assert "is not the table that this road was made for" in compile_with("walkers", "walkers")


def test_compile_and_show_list_what_a_recording_has_and_the_data_have_not(
    advercity: Command, tmp_path: Path
) -> None:
    out = tmp_path / "hill"
    ran = advercity(
        *("import", "trajectories", write_interaction(tmp_path), "--map", write_street(tmp_path)),
        *("--ego", "1", "--name", "hill", "--looks", "shaped", "--output", out),
    )
    assert ran.code == 0
    road = yaml.safe_load((out / "road.yaml").read_text())
    road["trajectories"]["left_out"] = [{"name": "trams", "count": 3, "line": 7}]
    (out / "road.yaml").write_text(yaml.safe_dump(road))

    ran = advercity("compile", SHIPPED, out, "--suite", "hill", "--output", tmp_path / "specs")
    shown = advercity("show", tmp_path / "specs/hill_clear_day_sparse.json")

    assert "road 'hill': left out: 3 trams (line 7)" in ran.err
    assert "3 trams (line 7)" in shown.out


def test_suggestions_are_printed_or_written(advercity: Command, tmp_path: Path) -> None:
    town = tmp_path / "3rd Town.osm"
    shutil.copy(DATA / "crossroads.osm", town)

    asked = advercity("import", "osm", town)
    assert (asked.code, asked.out) == (2, "")
    assert "--suggest" in asked.err

    printed = advercity("import", "osm", town, "--suggest")
    assert printed.code == 0
    assert "# town_3rd_town.yaml\nkind: road\nid: town_3rd_town\n" in printed.out
    assert "traffic drives on the right" in printed.err

    folder = tmp_path / "mine"
    written = advercity("import", "osm", town, "--output", folder, "--name", "mine")
    assert written.code == 0
    assert f"next: advercity compile library {folder} --suite mine --settle" in written.err
    again = advercity("import", "osm", town, "--output", folder, "--name", "mine")
    assert again.code == 2
    assert "already exists" in again.err


def test_a_network_of_sumo_is_suggested_conflicts(advercity: Command, tmp_path: Path) -> None:
    file = tmp_path / "town.net.xml"
    file.write_text(build_crossing_network(), encoding="utf-8")

    printed = advercity("import", "sumo-network", file, "--suggest")

    assert printed.code == 0
    assert "ltap_od_ego_turns" in printed.out
    assert "source: sumo" in printed.out
    assert "# town.yaml\nkind: road\nid: town\n" in printed.out


def test_a_simulation_of_somebody_else_becomes_a_dataset(
    advercity: Command, tmp_path: Path
) -> None:
    path = write_sumo_scenario(tmp_path / "theirs")
    out, data = tmp_path / "town", tmp_path / "data"

    asked = advercity("import", "sumo", path)
    nowhere = advercity("import", "sumo", path, "--ego", "north_1")
    ran = advercity(
        *("import", "sumo", path, "--ego", "north_1", "--connected-count", "0", "--from", "2"),
        *("--to", "5", "--looks", "shaped", "--output", out),
    )

    assert asked.code == 2
    assert "choose the ego among 2 vehicles with --ego; recorded longest: line_7" in asked.err
    assert nowhere.code == 2
    assert "the ego is north_1; give a folder for road, map and specs: --output" in nowhere.err
    assert ran.code == 0, ran.err
    assert "cav1 is north_1" in ran.err
    assert "left out: 1 option novelty (line 7)" in ran.err
    options = ("--frames", "10:12", "--backend", "fake", "--profile", "preview", "--scale", "0.05")
    assert advercity("run", *ran.out.split(), *options, "--output", data).code == 0
    assert advercity("verify", data).code == 0


def test_tracks_come_along_where_a_map_moves_to_a_local_origin(
    advercity: Command, tmp_path: Path
) -> None:
    far = write_street(tmp_path)
    far.write_text(far.read_text().replace('x="0" y="0"', 'x="691600" y="5335000"'))
    ran = advercity(
        *("import", "trajectories", write_interaction(tmp_path), "--map", far, "--ego", "1"),
        *("--offset", "691600", "5335000", "--looks", "shaped", "--output", tmp_path / "out"),
    )

    assert ran.code == 0, ran.err
    road = read_spec(Path(ran.out.split()[0])).road
    assert isinstance(road.imported, MapNetwork)
    assert isinstance(road.trajectories, TrajectorySet)
    away_m = np.subtract((691600, 5335000), road.imported.offset_m)
    ego = next(track for track in unpack_tracks(road.trajectories) if track.id == "1")
    own = next(track for track in read_recording(write_interaction(tmp_path)) if track.id == "1")
    assert np.abs(ego.places).max() < 1000
    np.testing.assert_allclose(ego.places[0], own.places[0] + away_m, atol=1e-5)
    assert road.ego.spawn_m == pytest.approx(ego.places[0], abs=5)

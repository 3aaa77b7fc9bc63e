"""The low sun of `glare_day` is where the ego looks, and nothing hides it."""

import math
import re
import shutil
from pathlib import Path

import numpy as np
import pytest
from advercity_dsl import Spec
from advercity_dsl.weather_components import Sun

from advercity.compiler import find_shipped_library, find_weather, load_library
from advercity.compiler.crossing import find_suite
from advercity.errors import InputError
from advercity.physics.sky import direction_from_elevation_azimuth
from advercity.pipeline.glare import compute_visible_fraction, solve_sun, solve_suns
from advercity.pipeline.preparation import load_or_build_world, load_or_simulate_traffic
from advercity.rendering.raycaster import Raycaster, Rays
from advercity.sensors.agent_poses import AgentPoses

pytestmark = pytest.mark.sumo

STEP = 10
"""Every second of a scenario."""
FARTHEST_M = 1000.0


@pytest.mark.parametrize("road", ["ui", "unj", "ri", "rsnj", "rcnj"])
def test_the_ego_sees_the_sun_for_more_than_half_of_its_route(
    specs: dict[str, Spec], road: str
) -> None:
    spec = specs[f"{road}_glare_day_sparse"]
    stage = load_or_simulate_traffic(spec)
    viewpoints, ego = AgentPoses(spec, stage.trace), spec.agents[0]
    caster = Raycaster(load_or_build_world(spec, stage.network_path))
    sun = direction_from_elevation_azimuth(
        spec.weather.sun.elevation_deg, spec.weather.sun.azimuth_deg
    )
    camera = ego.sensors.cameras[0].model
    across = math.tan(math.radians(camera.horizontal_fov_deg) / 2.0)
    down = across * camera.height_px / camera.width_px
    seen: list[bool] = []
    for index in range(0, len(stage.trace), STEP):
        frame = viewpoints.load_frame(index)
        front = viewpoints.world_from_sensors("camera", ego, frame)[0]
        ahead, left, up = front[:3, :3].T @ sun
        in_view = ahead > 0.0 and abs(left) < across * ahead and abs(up) < down * ahead
        caster.place(frame, hide=frozenset({ego.number}))
        ray = Rays(front[None, :3, 3].astype(np.float32), sun[None].astype(np.float32))
        seen.append(in_view and bool(np.isinf(caster.cast(ray, FARTHEST_M).range_m[0])))
    assert np.mean(seen) > 0.5


@pytest.mark.parametrize("road", ["ui", "rsnj"])
def test_the_sun_that_ships_is_the_one_that_is_found(specs: dict[str, Spec], road: str) -> None:
    spec = specs[f"{road}_glare_day_sparse"]
    found = solve_sun(spec, find_weather("glare_day").declaration.sun)
    assert found.elevation_deg == spec.weather.sun.elevation_deg
    assert abs(found.azimuth_deg - spec.weather.sun.azimuth_deg) <= 1.0
    assert found.visible_fraction >= 0.5
    assert found.visible_fraction == compute_visible_fraction(
        spec, Sun(elevation_deg=found.elevation_deg, azimuth_deg=found.azimuth_deg), 25.0
    )


def test_a_sun_that_cannot_be_in_view_is_an_error(specs: dict[str, Spec]) -> None:
    sought = Sun(in_view_of="ego", within_deg=8, seen_share=1.0)
    with pytest.raises(
        InputError, match=r"ui: no sun is within 8 deg .* allow more \(within_deg\)"
    ):
        solve_sun(specs["ui_glare_day_sparse"], sought)


def test_a_sun_behind_the_ego_is_not_visible(specs: dict[str, Spec]) -> None:
    behind = Sun(elevation_deg=5, azimuth_deg=180)
    assert compute_visible_fraction(specs["rsnj_glare_day_sparse"], behind, 60.0) == 0.0


def test_solve_keeps_the_suns_that_are_written_and_finds_the_others(tmp_path: Path) -> None:
    folder = tmp_path / "library"
    shutil.copytree(find_shipped_library(), folder)
    path = folder / "nhtsa" / "weather" / "glare_day.yaml"
    shipped = path.read_text()
    found = next(line for line in shipped.splitlines() if line.startswith("  rsnj:"))
    mine = shipped.replace(f"{found}\n", "").replace("oktas: 0}", "oktas: 0}  # mine")
    path.write_text(mine)
    library = load_library(folder)
    solved = list(solve_suns(library, find_suite(library, folder, suite=None)))
    assert len(solved) == 5
    added = [line for line in path.read_text().splitlines() if line not in mine.splitlines()]
    assert added == [found]
    assert [line for line in path.read_text().splitlines() if line != found] == mine.splitlines()


def test_a_hand_written_sun_that_does_not_shine_into_the_camera_is_an_error_and_stays(
    tmp_path: Path,
) -> None:
    folder = tmp_path / "library"
    shutil.copytree(find_shipped_library(), folder)
    path = folder / "nhtsa" / "weather" / "glare_day.yaml"
    mine = re.sub("  ui: .*", "  ui: {elevation_deg: 5, azimuth_deg: 0}  # mine", path.read_text())
    path.write_text(mine)
    library = load_library(folder)
    with pytest.raises(InputError, match=r"glare_day\.yaml:14:.* delete this sun"):
        list(solve_suns(library, find_suite(library, folder, suite=None)))
    assert path.read_text() == mine

"""The low sun of `glare_day` is where the ego looks, and nothing hides it."""

import math
from pathlib import Path

import numpy as np
import pytest
from advercity_dsl import Spec
from advercity_dsl.weather_components import Sun

from advercity.compiler import find_shipped_library, find_weather
from advercity.compiler.authoring import write_sun_positions
from advercity.errors import InputError
from advercity.physics.sky import direction_from_elevation_azimuth
from advercity.pipeline.agent_poses import AgentPoses
from advercity.pipeline.glare import compute_visible_fraction, solve_sun
from advercity.pipeline.preparation import load_or_build_world, load_or_simulate_traffic
from advercity.rendering.raycaster import Raycaster, Rays

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
    camera = ego.sensors.camera
    across = math.tan(math.radians(camera.horizontal_fov_deg) / 2.0)
    down = across * camera.height_px / camera.width_px
    seen: list[bool] = []
    for index in range(0, len(stage.trace), STEP):
        front = viewpoints.world_from_cameras(ego, index)[0]
        ahead, left, up = front[:3, :3].T @ sun
        in_view = ahead > 0.0 and abs(left) < across * ahead and abs(up) < down * ahead
        caster.place(viewpoints.load_frame(index), hide=frozenset({ego.number}))
        ray = Rays(front[None, :3, 3].astype(np.float32), sun[None].astype(np.float32))
        seen.append(in_view and bool(np.isinf(caster.cast(ray, FARTHEST_M).range_m[0])))
    assert np.mean(seen) > 0.5


@pytest.mark.parametrize("road", ["ui", "rsnj"])
def test_the_sun_that_ships_is_the_one_that_is_found(specs: dict[str, Spec], road: str) -> None:
    spec = specs[f"{road}_glare_day_sparse"]
    found = solve_sun(spec, find_weather("glare_day").declaration.sun)
    assert found.elevation_deg == spec.weather.sun.elevation_deg
    assert abs(found.azimuth_deg - spec.weather.sun.azimuth_deg) <= 1.0
    assert found.visible_fraction >= 0.55
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


def test_found_suns_are_written_where_others_were_and_comments_stay(tmp_path: Path) -> None:
    path = tmp_path / "glare_day.yaml"
    shipped = (find_shipped_library() / "nhtsa" / "weather" / "glare_day.yaml").read_text()
    path.write_text(shipped)
    write_sun_positions(path, {"ui": Sun(elevation_deg=7, azimuth_deg=183.5)})
    assert find_weather(str(path)).declaration.sun_at["ui"].azimuth_deg == 183.5
    kept = [line for line in shipped.splitlines() if not line.startswith("  ")]
    assert [line for line in path.read_text().splitlines() if not line.startswith("  ")] == kept
    path.write_text("kind: weather\nid: a\ntime: day\nsun: {in_view_of: ego}\nsky: {oktas: 0}\n")
    write_sun_positions(path, {"ui": Sun(elevation_deg=7, azimuth_deg=183.5)})
    assert find_weather(str(path)).declaration.sun_at["ui"].elevation_deg == 7
    path.write_text("{kind: weather, id: a, time: day, sun: {in_view_of: ego}}\n")
    with pytest.raises(InputError, match="does not begin a line"):
        write_sun_positions(path, {"ui": Sun(elevation_deg=7, azimuth_deg=183.5)})

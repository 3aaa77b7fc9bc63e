"""The low sun of `glare_day` is where the ego looks, and nothing hides it."""

import math

import numpy as np
import pytest
from advercity_dsl import Spec

from advercity.rendering.casting import Caster, Rays
from advercity.runner.stage import set_stage, world_of
from advercity.runner.viewpoints import Viewpoints
from advercity.weather.sky import direction_to

pytestmark = pytest.mark.sumo

STEP = 10
"""Every second of a scenario."""
FARTHEST_M = 1000.0


@pytest.mark.parametrize("road", ["ui", "unj", "ri", "rsnj", "rcnj"])
def test_the_ego_sees_the_sun_for_more_than_half_of_its_way(
    specs: dict[str, Spec], road: str
) -> None:
    spec = specs[f"{road}_glare_day_sparse"]
    stage = set_stage(spec)
    viewpoints, ego = Viewpoints(spec, stage.trace), spec.agents[0]
    caster = Caster(world_of(spec, stage.network))
    sun = direction_to(spec.weather.sun.elevation_deg, spec.weather.sun.azimuth_deg)
    camera = ego.sensors.camera
    across = math.tan(math.radians(camera.horizontal_fov_deg) / 2.0)
    down = across * camera.height_px / camera.width_px
    seen: list[bool] = []
    for index in range(0, len(stage.trace), STEP):
        front = viewpoints.camera_poses(ego, index)[0]
        ahead, left, up = front[:3, :3].T @ sun
        in_view = ahead > 0.0 and abs(left) < across * ahead and abs(up) < down * ahead
        caster.place(viewpoints.frame(index), hide=frozenset({ego.number}))
        ray = Rays(front[None, :3, 3].astype(np.float32), sun[None].astype(np.float32))
        seen.append(in_view and bool(np.isinf(caster.cast(ray, FARTHEST_M).range_m[0])))
    assert np.mean(seen) > 0.5

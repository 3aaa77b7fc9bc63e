"""The arrangement of the viewer's window."""

import math
from typing import Any

import numpy as np
import pytest
import rerun.blueprint as rrb
from advercity_dsl import Spec
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from advercity.geometry.poses import pose_matrix
from advercity.viewer.blueprint import build_blueprint
from advercity.viewer.shown import Curve, Picture, Shown

BLACK = np.zeros((2, 2, 3), np.uint8)
LEFT = Picture("camera0", "left", BLACK)
HEAT = Picture("thermal0", "heat", BLACK, group="thermal")
SLIP = Curve("slip", 0.5)


def build(spec: Spec, *shown: list[Shown], **given_: Any) -> dict[str, Any]:
    """Build a window of the spec's first agents; its named views and groups of views."""
    agents = spec.agents[: len(shown)]
    options: dict[str, Any] = {"world_from_first": np.eye(4), "map_tiles": False} | given_
    found: dict[str, Any] = {}
    waiting: list[Any] = [build_blueprint(agents, shown, **options).root_container]
    while waiting:
        part = waiting.pop()
        is_group = isinstance(part, rrb.Container)
        if part.name and (is_group or str(part.name) not in found):
            found[str(part.name)] = part
        waiting += part.contents if is_group else []
    return found


def origins(group: Any) -> list[str]:
    return [view.origin for view in group.contents]


def test_each_agent_with_pictures_has_its_first_in_front_and_all_in_a_tab(spec: Spec) -> None:
    first, second, third = (agent.id for agent in spec.agents[:3])
    window = build(spec, [SLIP, LEFT, HEAT], [], [HEAT])

    assert origins(window["front cameras"]) == [
        f"/world/{first}/camera0",
        f"/thermal/{third}/thermal0",
    ]
    assert [view.name for view in window["front cameras"].contents] == [first, third]
    assert origins(window[first]) == [f"/world/{first}/camera0", f"/thermal/{first}/thermal0"]
    assert [view.name for view in window[first].contents] == ["left", "heat"]
    assert origins(window[third]) == [f"/thermal/{third}/thermal0"]
    assert second not in window


def test_curves_of_all_agents_share_a_plot_after_the_motion(spec: Spec) -> None:
    window = build(spec, [SLIP], [SLIP, Curve("yaw_rate", 1.0)])
    expected = ["speed", "acceleration", "turn_rate", "latitude", "longitude", "altitude"]
    assert origins(window["motion"]) == [
        f"/plots/{name}" for name in [*expected, "slip", "yaw_rate"]
    ]
    assert "yaw rate" in window


@pytest.mark.parametrize(("map_tiles", "kind"), [(True, rrb.MapView), (False, rrb.Spatial2DView)])
def test_the_map_is_geographic_if_it_has_tiles(spec: Spec, map_tiles: bool, kind: type) -> None:
    assert isinstance(build(spec, [], map_tiles=map_tiles)["receivers"], kind)


@given(
    yaw_rad=st.floats(-math.pi, math.pi),
    pitch_rad=st.floats(-0.3, 0.3),
    place_m=st.tuples(*[st.floats(-500, 500)] * 3),
)
@settings(max_examples=20, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_the_eye_looks_level_along_the_first_agents_heading(
    spec: Spec, yaw_rad: float, pitch_rad: float, place_m: tuple[float, float, float]
) -> None:
    pose = pose_matrix(place_m, yaw=yaw_rad, pitch=pitch_rad)
    controls = build(spec, [], world_from_first=pose)["scene"].properties["EyeControls3D"]
    east, north, up = place_m
    ahead = np.array([math.cos(yaw_rad), math.sin(yaw_rad)])
    eye = np.ravel(controls.position.as_arrow_array().to_pylist())
    target = np.ravel(controls.look_target.as_arrow_array().to_pylist())
    # 24 m behind and 14 m above, at a point 10 m ahead.
    np.testing.assert_allclose(eye, [*(np.array([east, north]) - 24 * ahead), up + 14], atol=1e-3)
    np.testing.assert_allclose(target, [*(np.array([east, north]) + 10 * ahead), up], atol=1e-3)
    assert controls.tracking_entity.as_arrow_array().to_pylist() == [f"/world/{spec.agents[0].id}"]

"""The dark under and beside things on the ground."""

from dataclasses import replace
from typing import Literal

import numpy as np
import pytest
from advercity_sapien import SapienBackend
from advercity_sapien.contact_map import ContactMap
from advercity_sapien.light_probes import LightProbes, bake_light_probes

from advercity.compiler import find_weather
from advercity.geometry.mesh import Mesh
from advercity.geometry.poses import pose_matrix
from advercity.physics.atmosphere import compute_atmosphere
from advercity.physics.photometry import luminance
from advercity.rendering.backend import CameraCapture, CameraView, RenderProfile
from advercity.roads.lane_segments import LaneSegment
from advercity.semantics import Semantic
from advercity.testing import build_box, build_flat_world, make_actor_state, make_frame
from advercity.world import World


def place(*static: Mesh) -> tuple[World, LightProbes]:
    """Flat asphalt with a lane from (-10, 0) to (10, 0), and its probes on a cloudy day."""
    x = np.array([-10.0, 10.0])
    left, right = (np.column_stack([x, np.full(2, y), np.zeros(2)]) for y in (1.75, -1.75))
    lane = LaneSegment("road.+1", "driving", left, right)
    world = replace(build_flat_world(*static), lanes=(lane,))
    air = compute_atmosphere(find_weather("soft_rain_day").declaration, "urban")
    return world, bake_light_probes(world, air)


def seen_from_behind(world: World, renderer: Literal["raster", "ray_traced"]) -> CameraCapture:
    """Picture on a clear day, from 9 m behind the origin and 3 m above it."""
    air = compute_atmosphere(find_weather("clear_day").declaration, "urban")
    profile = RenderProfile("test", 1.0, renderer, samples=64, path_depth=4)
    with SapienBackend().open(world, air, profile) as opened:
        opened.place(make_frame())
        pose = pose_matrix((-9.0, 0.0, 3.0), pitch=0.18)
        return opened.render_camera(CameraView(pose, 120, 80, np.radians(40.0)))


def light_at(contact: ContactMap, probes: LightProbes, x: float, y: float) -> float:
    """Fraction of the light left at a point."""
    rows, columns = contact.texels.shape
    column = int((x - probes.corner[0]) / probes.size[0] * columns)
    row = int((y - probes.corner[1]) / probes.size[1] * rows)
    return float(contact.texels[row, column]) / 255.0


def test_ground_is_dark_under_a_car_and_bright_a_width_away() -> None:
    world, probes = place()
    contact = ContactMap(world, probes)
    contact.place(make_frame(make_actor_state(1, 0.0, yaw_rad=np.pi / 2.0)))
    assert light_at(contact, probes, 0.0, 0.0) < 0.1
    # The car is 4 m by 2 m and stands across the lane.
    assert light_at(contact, probes, 0.0, 1.7) < 0.1
    assert 0.3 < light_at(contact, probes, 1.1, 0.0) < 0.8
    assert light_at(contact, probes, 3.2, 0.0) > 0.97


def test_a_car_that_left_leaves_no_shadow() -> None:
    world, probes = place()
    contact = ContactMap(world, probes)
    contact.place(make_frame(make_actor_state(1, 0.0)))
    contact.place(make_frame())
    assert light_at(contact, probes, 0.0, 0.0) == 1.0


@pytest.mark.render
def test_a_car_is_dark_by_its_own_contact_neither_on_its_roof_nor_on_its_sides() -> None:
    """As in a traced picture, its roof mirrors the sky, and ground shines on its sides."""
    body = build_box(
        (4.0, 2.0, 1.1), (0.0, 0.0, 0.75), material="car_paint_black", semantic=Semantic.VEHICLE
    )
    world, _ = place(body)
    found, expected = (seen_from_behind(world, kind) for kind in ("raster", "ray_traced"))
    upright = expected.normal[..., 2]
    is_body = expected.semantic == Semantic.VEHICLE
    for where, tolerance in ((is_body & (upright > 0.9), 0.06), (is_body & (upright < 0.1), 0.12)):
        light, true_light = (
            float(luminance(one.radiance)[where].mean()) for one in (found, expected)
        )
        assert light == pytest.approx(true_light, rel=tolerance)


@pytest.mark.parametrize(
    ("bottom_m", "semantic", "is_dark"),
    [
        (0.3, Semantic.VEHICLE, True),  # a parked car
        (0.0, Semantic.STATIC, True),  # a bin
        (-0.009, Semantic.STATIC, True),
        (0.009, Semantic.STATIC, True),
        (-1.3, Semantic.STATIC, False),  # a foundation
        (4.0, Semantic.TRAFFIC_SIGN, False),
        (-0.85, Semantic.VEGETATION, False),  # young crops
    ],
)
def test_static_things_darken_the_ground_if_they_are_close_to_it(
    bottom_m: float, semantic: Semantic, is_dark: bool
) -> None:
    thing = build_box((2.0, 2.0, 1.0), (0.0, 6.0, bottom_m + 0.5), semantic=semantic)
    world, probes = place(thing)
    contact = ContactMap(world, probes)
    contact.place(make_frame())
    assert (light_at(contact, probes, 0.0, 6.0) < 0.2) == is_dark

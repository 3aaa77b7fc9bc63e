"""Obstacles before the sky around probes, and their reflections."""

from dataclasses import replace

import numpy as np
import pytest
from advercity_sapien import SapienBackend
from advercity_sapien.light_probes import bake_light_probes
from advercity_sapien.skylines import AZIMUTHS, NEAREST_M

from advercity.geometry.mesh import Mesh
from advercity.geometry.poses import pose_matrix
from advercity.materials import MATERIALS
from advercity.physics.photometry import luminance
from advercity.rendering.backend import CameraView, RenderProfile
from advercity.roads.lane_segments import LaneSegment
from advercity.testing import build_box, build_flat_world, make_frame
from advercity.world import World
from tests.box_scenes import air_of, uniform

LEVEL_HEIGHT_M = 1.5
EAST, NORTH, SOUTH = 0, AZIMUTHS // 4, 3 * AZIMUTHS // 4
SKY = air_of(sky=lambda sine: np.where(sine > 0.0, 1000.0, 0.0))


def place(*static: Mesh) -> World:
    """Flat asphalt with a lane from (-20, 0) to (20, 0)."""
    x = np.array([-20.0, 20.0])
    left, right = (np.column_stack([x, np.full(2, y), np.zeros(2)]) for y in (1.75, -1.75))
    lane = LaneSegment("road.+1", "driving", left, right)
    return replace(build_flat_world(*static), lanes=(lane,))


def look(world: World, x: float, y: float, azimuth: int) -> tuple[float, float, float]:
    """Tangent of the skyline, its distance in metres and luminance at the nearest probe."""
    probes = bake_light_probes(world, SKY)
    rows = len(probes.skylines.light) // AZIMUTHS
    column = int((x - probes.corner[0]) / probes.size[0] * probes.light.shape[1])
    row = azimuth * rows + int((y - probes.corner[1]) / probes.size[1] * rows)
    *light, tangent = probes.skylines.light[row, column].astype(float)
    nearness = float(probes.skylines.nearness[row, column]) / 255.0
    return tangent, NEAREST_M / max(nearness, 1e-9), float(luminance(np.array(light)))


def test_a_house_hides_the_sky_up_to_its_eaves() -> None:
    """Its wall is 18.75 m north of the probe; others are at most 3 m nearer or farther."""
    house = build_box((400.0, 30.0, 12.0), (0.0, 33.75, 6.0), material="plaster")
    tangent, distance_m, light = look(place(house), 0.0, 0.0, NORTH)
    assert tangent == pytest.approx((12.0 - LEVEL_HEIGHT_M) / 18.75, rel=0.15)
    assert distance_m == pytest.approx(18.75, rel=0.1)
    # Half of the sky, and the ground's reflection of it.
    half = 500.0 * luminance(np.array(MATERIALS["plaster"].albedo))
    assert half < light < 1.4 * half


def test_nothing_hides_the_sky_in_the_open_nor_away_from_a_house() -> None:
    house = build_box((400.0, 30.0, 12.0), (0.0, 33.75, 6.0))
    assert look(place(), 0.0, 0.0, EAST)[0] == 0.0
    assert look(place(house), 0.0, 0.0, SOUTH)[0] == 0.0


@pytest.mark.render
@pytest.mark.parametrize("height_m", [1.5, 9.0])
def test_a_pane_mirrors_the_house_behind_the_camera(height_m: float) -> None:
    """As in a traced picture; the house is 8 m high: the upper pane looks over it."""
    pane = build_box((12.0, 40.0, 20.0), (17.5, 0.0, 10.0), material="room_dark")
    house = build_box((1.0, 400.0, 8.0), (-16.0, 0.0, 4.0), material="rubber")
    air = air_of(sky=uniform(1000.0))
    view = CameraView(pose_matrix((9.0, 0.0, height_m)), 60, 40, np.radians(40.0))
    light: dict[str, float] = {}
    for renderer in ("raster", "ray_traced"):
        profile = RenderProfile("test", 1.0, renderer, samples=64, path_depth=4)
        with SapienBackend().open(place(pane, house), air, profile) as opened:
            opened.place(make_frame())
            light[renderer] = float(luminance(opened.render_camera(view).radiance).mean())
    # It mirrors 4.5 % of a sky of 1000 cd/m².
    assert light["raster"] == pytest.approx(light["ray_traced"], abs=5.0)

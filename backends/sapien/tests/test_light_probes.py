"""Daylight by walls, in the open and inside houses, from baked probes."""

from dataclasses import replace

import numpy as np
import pytest
from advercity_sapien.light_probes import LEVEL_HEIGHTS_M, LightProbes, bake_light_probes
from numpy.typing import NDArray

from advercity.compiler import find_weather
from advercity.geometry.mesh import Mesh
from advercity.physics.atmosphere import compute_atmosphere
from advercity.physics.photometry import luminance
from advercity.roads.lane_segments import LaneSegment
from advercity.testing import build_box, build_flat_world

UP = np.array([0.0, 0.0, 1.0])


def bake(weather: str, *static: Mesh) -> LightProbes:
    """Probes of flat asphalt with a lane from (-20, 0) to (20, 0)."""
    x = np.array([-20.0, 20.0])
    left, right = (np.column_stack([x, np.full(2, y), np.zeros(2)]) for y in (1.75, -1.75))
    lane = LaneSegment("road.+1", "driving", left, right)
    world = replace(build_flat_world(*static), lanes=(lane,))
    return bake_light_probes(world, compute_atmosphere(find_weather(weather).declaration, "urban"))


def light_on(
    probes: LightProbes, x: float, y: float, normal: NDArray[np.float64] = UP
) -> NDArray[np.float64]:
    """Light (3,) on a surface near the ground relative to the open, at the nearest probe."""
    rows = len(probes.light) // len(LEVEL_HEIGHTS_M)
    column = int((x - probes.corner[0]) / probes.size[0] * probes.light.shape[1])
    row = int((y - probes.corner[1]) / probes.size[1] * rows)
    own = 1.0 + 2.0 * float(probes.direction[row, column, :3] @ normal)
    in_the_open = 1.0 + 2.0 * float(probes.open_direction @ normal)
    return probes.light[row, column, :3].astype(np.float64) * own / in_the_open


def test_the_open_keeps_the_light_of_the_sky() -> None:
    assert light_on(bake("soft_rain_day"), 0.0, 0.0) == pytest.approx(1.0, abs=0.03)


def test_a_long_wall_halves_the_light_at_its_foot() -> None:
    """A black wall takes half of a uniform sky; a grey one returns some of it."""
    wall = build_box((200.0, 1.0, 20.0), (0.0, 10.0, 10.0), material="rubber")
    probes = bake("soft_rain_day", wall)
    assert luminance(light_on(probes, 0.0, 8.0)) == pytest.approx(0.5, abs=0.12)
    assert luminance(light_on(probes, 0.0, -28.0)) > 0.85


def test_a_sunlit_red_wall_reddens_what_is_before_it() -> None:
    """The sun is in the south, so the wall's southern side is lit."""
    wall = build_box((200.0, 1.0, 10.0), (0.0, 10.0, 5.0), material="brick")
    towards_wall = np.array([0.0, 1.0, 0.0])
    red, _, blue = light_on(bake("clear_day", wall), 0.0, 7.0, towards_wall)
    assert red > 1.5 * blue


def test_probes_inside_a_house_have_the_light_outside() -> None:
    house = build_box((12.0, 12.0, 12.0), (0.0, 15.0, 6.0))
    probes = bake("soft_rain_day", house)
    assert luminance(light_on(probes, 0.0, 15.0)) > 0.4


def test_nights_and_worlds_without_lanes_have_no_probes() -> None:
    air = compute_atmosphere(find_weather("clear_day").declaration, "urban")
    assert bake("clear_night").extent == (0.0, 0.0, 0.0, 0.0)
    assert bake_light_probes(build_flat_world(), air).extent == (0.0, 0.0, 0.0, 0.0)

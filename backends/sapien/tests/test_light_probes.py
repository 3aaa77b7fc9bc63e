"""Daylight by walls, in the open and inside houses, from baked probes."""

from dataclasses import replace

import numpy as np
import pytest
from advercity_sapien.light_probes import LightProbes, bake_light_probes, compute_irradiance
from advercity_sapien.probe_grid import LEVEL_HEIGHTS_M
from numpy.typing import NDArray
from scipy.spatial import KDTree

from advercity.compiler import find_weather
from advercity.geometry.mesh import Mesh
from advercity.materials import MATERIALS
from advercity.physics.atmosphere import Atmosphere, compute_atmosphere
from advercity.physics.photometry import cubemap_directions, cubemap_solid_angles, luminance
from advercity.rendering.raycaster import MATERIAL_NAMES, Raycaster, Rays
from advercity.roads.lane_segments import LaneSegment
from advercity.testing import build_box, build_flat_world
from advercity.world import World
from tests.box_scenes import air_of, grey, uniform

UP = np.array([0.0, 0.0, 1.0])
WALL_HEIGHTS_M = LEVEL_HEIGHTS_M[1:4]


def place(*static: Mesh) -> World:
    """Flat asphalt with a lane from (-20, 0) to (20, 0)."""
    x = np.array([-20.0, 20.0])
    left, right = (np.column_stack([x, np.full(2, y), np.zeros(2)]) for y in (1.75, -1.75))
    lane = LaneSegment("road.+1", "driving", left, right)
    return replace(build_flat_world(*static), lanes=(lane,))


def bake(weather: str, *static: Mesh) -> LightProbes:
    air = compute_atmosphere(find_weather(weather).declaration, "urban")
    return bake_light_probes(place(*static), air)


def light_on(
    probes: LightProbes,
    x: float,
    y: float,
    normal: NDArray[np.float64] = UP,
    *,
    height_m: float = LEVEL_HEIGHTS_M[0],
) -> NDArray[np.float64]:
    """Light (3,) on a surface relative to the open, at the nearest probe."""
    rows = len(probes.light) // len(LEVEL_HEIGHTS_M)
    column = int((x - probes.corner[0]) / probes.size[0] * probes.light.shape[1])
    row = int((y - probes.corner[1]) / probes.size[1] * rows)
    row += rows * LEVEL_HEIGHTS_M.index(height_m)
    shape = np.concatenate([half[row, column] for half in probes.shape])
    own, in_the_open = (
        compute_irradiance(np.concatenate([np.ones(3), one])[None], normal[None])[0]
        for one in (shape, probes.open_shape)
    )
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


def build_street(material: str) -> list[Mesh]:
    """Houses 12 m high and 18 m apart along the lane, as good as endless."""
    return [
        build_box((400.0, 30.0, 12.0), (0.0, side * 24.0, 6.0), material=material)
        for side in (1.0, -1.0)
    ]


def test_a_wall_has_the_sky_above_the_house_across_the_street() -> None:
    """1 - sin(a) of an open wall's light, if the house ends at an elevation a (black ones).

    Probes are 2.75 m before the wall, 15.25 m from the other; rubber and asphalt reflect a little.
    """
    air = air_of(sky=lambda sine: np.where(sine > 0.0, 1000.0, 0.0))
    probes = bake_light_probes(place(*build_street("rubber")), air)
    south, heights = np.array([0.0, -1.0, 0.0]), np.array(WALL_HEIGHTS_M)
    light = [luminance(light_on(probes, 0.0, 6.25, south, height_m=one)) for one in heights]
    sky = 1.0 - np.sin(np.arctan2(12.0 - heights, 15.25))
    assert np.mean(sky) < np.mean(light) < np.mean(sky) + 0.08


def test_walls_of_a_street_have_the_light_that_traced_paths_find() -> None:
    """A Monte Carlo follows paths to their end under an overcast sky, between dry surfaces.

    In a street surfaces reflect less than in the open, and repeated reflections count.
    """
    overcast = compute_atmosphere(find_weather("soft_rain_day").declaration, "urban")
    air = replace(overcast, wetness=0.0, puddle_coverage=0.0)
    world, north = place(*build_street("plaster")), np.array([0.0, 1.0, 0.0])
    probes, in_the_open = bake_light_probes(world, air), compute_open_irradiance(air, north)
    found: list[float] = []
    traced: list[float] = []
    for height_m in WALL_HEIGHTS_M:
        light = luminance(light_on(probes, 0.0, -8.75, north, height_m=height_m))
        found.append(float(light) * in_the_open)
        traced.append(trace_irradiance(world, air, np.array([0.0, -8.75, height_m]), north))
    assert np.mean(found) == pytest.approx(np.mean(traced), rel=0.03)


def compute_open_irradiance(air: Atmosphere, normal: NDArray[np.float64]) -> float:
    """Irradiance in lx of a surface under the whole cubemap of the sky."""
    size = air.sky.shape[1]
    cosine = np.clip(cubemap_directions(size) @ normal, 0.0, None)
    return float(np.sum(luminance(air.sky) * cosine * cubemap_solid_angles(size)))


def trace_irradiance(
    world: World, air: Atmosphere, point: NDArray[np.float64], normal: NDArray[np.float64]
) -> float:
    """Trace the irradiance in lx by paths of diffuse reflection; the sun shines on all of them."""
    raycaster, random = Raycaster(world), np.random.default_rng(1)
    albedo = luminance(np.array([MATERIALS[name].albedo for name in MATERIAL_NAMES]))
    size = air.sky.shape[1]
    texels = luminance(air.sky).reshape(-1)
    sky = KDTree(cubemap_directions(size).reshape(-1, 3))
    points, normals = (np.tile(one, (20_000, 1)) for one in (point, normal))
    left, total = np.ones(len(points)), 0.0
    while len(points):
        ray = normals + spread_randomly(random, len(points))
        ray /= np.linalg.norm(ray, axis=1)[:, None]
        hits = raycaster.cast(Rays(points.astype(np.float32), ray.astype(np.float32)), 1e3)
        is_hit = np.isfinite(hits.range_m)
        total += float(np.sum(left[~is_hit] * texels[sky.query(ray[~is_hit])[1]]))
        normals = hits.normal[is_hit].astype(np.float64)
        points = points[is_hit] + ray[is_hit] * hits.range_m[is_hit, None] + 1e-3 * normals
        left = left[is_hit] * albedo[hits.material[is_hit]]
        sun = np.broadcast_to(air.sun_direction, points.shape).astype(np.float32)
        lit = np.isinf(raycaster.cast(Rays(points.astype(np.float32), sun), 1e3).range_m)
        cosine = np.clip(normals @ air.sun_direction, 0.0, None)
        total += float(np.sum(left * lit * cosine)) * air.sun_lx / np.pi
        goes_on = left > 1e-3
        points, normals, left = points[goes_on], normals[goes_on], left[goes_on]
    return np.pi * total / 20_000


def spread_randomly(random: np.random.Generator, count: int) -> NDArray[np.float64]:
    """Unit vectors (count, 3); added to a normal they are spread by the cosine."""
    vectors = random.normal(size=(count, 3))
    return vectors / np.linalg.norm(vectors, axis=1)[:, None]


def test_fog_veils_the_wall_that_hides_the_sky() -> None:
    """In air as bright as the sky, a black wall at 30 m hides nothing in fog of 30 m."""
    wall = build_box((400.0, 1.0, 40.0), (0.0, 30.0, 20.0), material="rubber")
    towards = np.array([0.0, 1.0, 0.0])
    left: dict[float, float] = {}
    for mor_m in (1e9, 30.0):
        air = air_of(mor_m=mor_m, sky=uniform(1000.0), airlight=grey(1000.0))
        before, behind = (
            luminance(light_on(bake_light_probes(world, air), 0.0, 0.0, towards))
            for world in (place(wall), place())
        )
        left[mor_m] = float(before / behind)
    assert left[30.0] == pytest.approx(1.0, abs=0.03)
    assert left[1e9] < 0.7


def test_probes_inside_a_house_have_the_light_outside() -> None:
    house = build_box((12.0, 12.0, 12.0), (0.0, 15.0, 6.0))
    probes = bake("soft_rain_day", house)
    assert luminance(light_on(probes, 0.0, 15.0)) > 0.4


def test_nights_and_worlds_without_lanes_have_no_probes() -> None:
    air = compute_atmosphere(find_weather("clear_day").declaration, "urban")
    assert bake("clear_night").extent == (0.0, 0.0, 0.0, 0.0)
    assert bake_light_probes(build_flat_world(), air).extent == (0.0, 0.0, 0.0, 0.0)

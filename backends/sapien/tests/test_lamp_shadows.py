"""Shadows of lamps: the raster pack against rays, and against geometry."""

from collections.abc import Iterator
from typing import Literal

import numpy as np
import pytest
from advercity_sapien import SapienBackend
from numpy.typing import NDArray

from advercity.frames import Actor, ActorState, Frame, Lamp
from advercity.geometry.mesh import Mesh
from advercity.geometry.poses import Matrix, pose_matrix
from advercity.physics.extinction import AirExtinction, extinction_from_mor
from advercity.physics.weather_parts.part import Extinction, Suspension
from advercity.rendering.backend import CameraView, RenderProfile
from advercity.semantics import Semantic
from advercity.world import Body, World
from tests.render_builders import LUMINANCE, build_box, build_clear_air, set_matt_materials

pytestmark = pytest.mark.render

Pack = Literal["raster", "ray_traced"]
Images = dict[str, NDArray[np.floating]]
GROUND = build_box((0, 0, -0.5), (200, 200, 1), "matt", Semantic.ROAD)
WALL = build_box((20.5, 0, 2), (1, 190, 4), "matt")
SLAB = build_box((10, 2, 1), (0.2, 2, 2), "matt")
HIDDEN = build_box((30, 0, 1), (1, 10, 2), "matt")
CAR, PEDESTRIAN = (4.0, 1.8, 1.5), (0.4, 0.6, 1.8)
LAMP_X, LAMP_Y = CAR[0] / 2 + 0.1, 0.63
PEDESTRIAN_AT = 10.0, -2.5
TOWARDS_WALL = pose_matrix((12.0, 0.0, 0.25))
"""Eight metres before the wall, below the cut-off: ten pixels a metre, y = 0 in the middle."""
BEHIND_WALL = pose_matrix((22.0, 0.0, 1.0))
ALONG_WALL = pose_matrix((23.0, -10.0, 1.0), yaw=np.pi / 2)


@pytest.fixture(scope="module")
def lit() -> Iterator[dict[Pack, Images]]:
    """Images of the slab, with a pedestrian, and behind the wall, by pack."""
    with pytest.MonkeyPatch.context() as patch:
        set_matt_materials(patch, matt=0.5)
        yield {pack: render(pack, WALL, SLAB, HIDDEN) for pack in ("raster", "ray_traced")}


def render(pack: Pack, *static: Mesh, mor_m: float = 1e9) -> Images:
    """Luminance (24, 160) in cd/m² before the low beams of a car at the origin, by view."""
    car = state_of(1, "car", (0.0, 0.0), CAR, Lamp.LOW_BEAM)
    pedestrian = state_of(2, "pedestrian", PEDESTRIAN_AT, PEDESTRIAN, Lamp(0))
    bodies = {
        name: Body((build_box((0, 0, size[2] / 2), size, "matt"),), size)
        for name, size in (("car", CAR), ("pedestrian", PEDESTRIAN))
    }
    world = World("test", (GROUND, *static), bodies, (), network=None)  # pyright: ignore[reportArgumentType]
    fog = AirExtinction((Suspension("fog", Extinction(extinction_from_mor(mor_m))),))
    air = build_clear_air(extinction=fog, night=True)
    profile = RenderProfile("test", 1.0, pack, samples=64, path_depth=0)
    shots: tuple[tuple[str, tuple[ActorState, ...], Matrix], ...] = (
        ("slab", (car,), TOWARDS_WALL),
        ("behind", (car,), BEHIND_WALL),
        ("along", (car,), ALONG_WALL),
        ("pedestrian", (car, pedestrian), TOWARDS_WALL),
    )
    images: Images = {}
    with SapienBackend().open(world, air, profile) as renderer:
        for name, states, camera in shots:
            renderer.place(Frame(0, 0.0, states, {}))
            view = CameraView(camera, 160, 24, np.radians(90.0), frozenset({1}))
            images[name] = renderer.render_camera(view).radiance @ LUMINANCE
    return images


def state_of(
    number: int,
    name: Literal["car", "pedestrian"],
    at: tuple[float, float],
    size: tuple[float, float, float],
    lamps: Lamp,
) -> ActorState:
    actor = Actor(number, name, name, "matt", size)
    return ActorState(actor, pose_matrix((*at, 0.0)), 0.0, 0.0, lamps)


def test_a_wall_behind_a_slab_is_lit_as_rays_light_it(lit: dict[Pack, Images]) -> None:
    raster, traced = (lit[pack]["slab"][12] for pack in ("raster", "ray_traced"))
    # The slab is from y = 1 to 3, 7.9 m from the lamps, which are 17.9 m from the wall: the left
    # lamp's shadow is from 1.5 to 6.0 m, the right lamp's from 3.1 to 7.6. Edges are blurred.
    free, one, both = np.r_[70:155], np.r_[54:61, 8:16], np.r_[24:45]
    assert raster[free] == pytest.approx(traced[free], rel=0.1)
    assert raster[one].mean() == pytest.approx(traced[one].mean(), rel=0.1)
    assert max(raster[both].max(), traced[both].max()) == 0.0


@pytest.mark.parametrize("pack", ["raster", "ray_traced"])
def test_a_pedestrian_throws_shadows_on_the_wall_behind(
    lit: dict[Pack, Images], pack: Pack
) -> None:
    left_of_light = lit[pack]["pedestrian"][12] / np.maximum(lit[pack]["slab"][12], 1e-9)
    for lamp_y in (LAMP_Y, -LAMP_Y):
        # By similar triangles.
        y = lamp_y + (PEDESTRIAN_AT[1] - lamp_y) * (20.0 - LAMP_X) / (PEDESTRIAN_AT[0] - LAMP_X)
        # Of two lamps one is left. The shadow is 13 pixels wide; a traced one has 6 % of noise.
        middle = round(80 - 10 * y)
        assert left_of_light[middle - 2 : middle + 3].mean() < 0.7
    assert left_of_light[80:100] == pytest.approx(1.0, abs=0.02)


@pytest.mark.parametrize("pack", ["raster", "ray_traced"])
def test_nothing_is_lit_through_a_wall(lit: dict[Pack, Images], pack: Pack) -> None:
    assert lit[pack]["behind"].max() == 0.0


def test_air_behind_a_wall_does_not_glow(monkeypatch: pytest.MonkeyPatch) -> None:
    set_matt_materials(monkeypatch, matt=0.5)
    behind = render("raster", WALL, mor_m=75.0)["along"]
    free = render("raster", mor_m=75.0)["along"][12, 80]
    assert free > 0.03
    assert behind.max() < 0.02 * free

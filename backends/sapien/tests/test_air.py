"""Effects of air on cameras' images, with both shader packs."""

import numpy as np
import pytest

from advercity.geometry.poses import pose_matrix
from advercity.semantics import Semantic
from tests.box_scenes import (
    Open,
    air_of,
    centre,
    frame_of,
    grey,
    luminance,
    state,
    uniform,
    view_of,
    world_of,
)
from tests.render_builders import (
    build_box,
)

pytestmark = [pytest.mark.render, pytest.mark.usefixtures("ideal_surfaces")]


@pytest.mark.parametrize(("distance_m", "left"), [(25.0, 0.368), (50.0, 0.136), (75.0, 0.050)])
def test_fog_leaves_the_contrast_of_koschmieder(
    opened: Open, distance_m: float, left: float
) -> None:
    airlight = 2500.0
    air = air_of(mor_m=75.0, sky=uniform(airlight), sun_lx=5e4, airlight=grey(airlight))
    with opened(world_of(), air) as renderer:
        seen: dict[str, float] = {}
        for number, paint in enumerate(("black", "white"), start=1):
            # The front of the box is a metre before its middle.
            renderer.place(frame_of(state(number, (distance_m + 1.0, 0.0, 0.0), paint=paint)))
            seen[paint] = centre(luminance(renderer.render_camera(view_of(size=(401, 401)))))
    bare = 5e4 * np.cos(np.radians(45.0)) / np.pi + airlight
    assert (airlight - seen["black"]) / airlight == pytest.approx(left, rel=0.02)
    assert (seen["white"] - seen["black"]) / bare == pytest.approx(left, rel=0.02)


def test_fog_counts_along_the_ray_and_not_along_the_axis(opened: Open) -> None:
    air = air_of(mor_m=75.0, sky=uniform(1000.0), airlight=grey(1000.0))
    wall = build_box((21.0, 0.0, 0.0), (2.0, 60.0, 60.0), "black")
    with opened(world_of(wall), air) as renderer:
        renderer.place(frame_of())
        capture = renderer.render_camera(view_of(size=(100, 100)))
    slant = np.sqrt(1.0 + 2.0 * ((5.5 - 50.0) / 50.0) ** 2)
    expected = 1000.0 * (1.0 - 0.05 ** (20.0 * slant / 75.0))
    assert float(luminance(capture)[5, 5]) == pytest.approx(expected, rel=0.01)
    assert capture.depth[5, 5] == pytest.approx(20.0, abs=1e-3)


def test_sky_is_shown_as_it_is_whatever_the_fog(opened: Open) -> None:
    air = air_of(mor_m=75.0, sky=lambda sine: 1000.0 + 500.0 * sine, airlight=grey(1.0))
    with opened(world_of(), air) as renderer:
        renderer.place(frame_of())
        capture = renderer.render_camera(
            view_of(pose_matrix((0, 0, 1), pitch=-np.pi / 2), size=(41, 41))
        )
    assert centre(luminance(capture)) == pytest.approx(1500.0, rel=2e-3)
    assert np.all(np.isinf(capture.depth))
    assert np.all(capture.semantic == Semantic.SKY)
    assert np.all(capture.normal == 0.0)

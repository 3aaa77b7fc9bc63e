"""A renderer of each shader pack, over ideal surfaces."""

from contextlib import AbstractContextManager
from typing import Literal

import pytest
from advercity_sapien import SapienBackend
from advercity_sapien.renderer import SapienRenderer

from advercity.physics.atmosphere import Atmosphere
from advercity.rendering.backend import RenderProfile
from advercity.world import World
from tests.box_scenes import Open
from tests.render_builders import (
    PACKS,
    set_matt_materials,
)


@pytest.fixture
def ideal_surfaces(monkeypatch: pytest.MonkeyPatch) -> None:
    set_matt_materials(monkeypatch, black=0.0, grey=0.5, white=1.0)


@pytest.fixture(scope="module", params=PACKS)
def renderer(request: pytest.FixtureRequest) -> Literal["raster", "ray_traced"]:
    return request.param


@pytest.fixture
def opened(renderer: Literal["raster", "ray_traced"], ideal_surfaces: None) -> Open:
    def open_it(
        world: World, air: Atmosphere, *, samples: int = 1, path_depth: int = 1
    ) -> AbstractContextManager[SapienRenderer]:
        profile = RenderProfile("test", 1.0, renderer, samples=samples, path_depth=path_depth)
        return SapienBackend().open(world, air, profile)

    return open_it

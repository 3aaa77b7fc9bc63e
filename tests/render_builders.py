"""Boxes, matt materials and simple air for tests of renderers."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import ArrayLike

from advercity.geometry.mesh import Mesh
from advercity.materials import CONCRETE_77GHZ, MATERIALS, Material
from advercity.physics.atmosphere import Atmosphere
from advercity.physics.extinction import AirExtinction
from advercity.physics.photometry import LUMINANCE_WEIGHTS
from advercity.physics.sky import build_airlight_cubemap
from advercity.rendering.raycaster import MATERIAL_INDEX
from advercity.semantics import Semantic

PACKS = ("raster", pytest.param("ray_traced", marks=pytest.mark.slow))
"""Shader packs as parameters: both have the same physics, so a commit tries one, the night both."""
LUMINANCE = LUMINANCE_WEIGHTS
BOX_CORNERS = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
BOX_TRIANGLES = np.array(
    [
        *([0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1]),
        *([2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3]),
    ],
    dtype=np.int32,
)


def build_box(
    middle: ArrayLike,
    size: ArrayLike,
    material: str = "grey",
    semantic: Semantic = Semantic.BUILDING,
) -> Mesh:
    """Build a box of flat faces."""
    vertices = np.asarray(middle) + BOX_CORNERS * np.asarray(size) / 2.0
    return Mesh(f"box {middle}", vertices.astype(np.float32), BOX_TRIANGLES, material, semantic)


def set_matt_materials(monkeypatch: pytest.MonkeyPatch, **albedos: float) -> None:
    """Replace or add materials by Lambertian grey ones for the time of a test."""
    for name, albedo in albedos.items():
        matt = Material((albedo, albedo, albedo), 0.5, CONCRETE_77GHZ, roughness=1.0)
        monkeypatch.setitem(MATERIALS, name, matt)
        # Lamps of the raster pack cast rays, and do not look at what they hit.
        monkeypatch.setitem(MATERIAL_INDEX, name, MATERIAL_INDEX.get(name, 0))


def build_clear_air(luminance: float = 0.0, **changes: Any) -> Atmosphere:
    """Build a vacuum under a uniform sky, without sun and lamps."""
    air = Atmosphere(
        extinction=AirExtinction(),
        sun_direction=np.array([-0.6, 0.0, 0.8]),
        sun_lx=0.0,
        sun_colour=(1.0, 1.0, 1.0),
        sky_lx=np.pi * luminance,
        sky=np.full((6, 32, 32, 3), luminance, dtype=np.float32),
        airlight=build_airlight_cubemap((0.0, 0.0, 0.0), (0.0, 0.0, 0.0)),
        street_lx=0.0,
        wetness=0.0,
        puddle_coverage=0.0,
        night=False,
    )
    return replace(air, **changes)

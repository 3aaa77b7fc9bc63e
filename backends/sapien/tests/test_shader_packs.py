"""The shaders' use of Vulkan, as graphics cards see it: the software driver allows more."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from advercity_sapien.shader_constants import SHADER_FOLDER

LAYER = Path("/usr/share/vulkan/explicit_layer.d/VkLayer_khronos_validation.json")
INCLUDE = re.compile(r'#include "(.+)"')
SCRIPT = """
from advercity_sapien import SapienBackend
from advercity.geometry.poses import pose_matrix
from advercity.rendering.backend import RenderProfile
from advercity.semantics import Semantic
from tests.box_scenes import air_of, frame_of, uniform, view_of, world_of
from tests.render_builders import build_box

world = world_of(
    build_box((10.0, 0.0, 0.0), (1.0, 2.0, 3.0), "asphalt"),
    build_box((8.0, 3.0, 0.0), (0.01, 2.0, 3.0), "glass", Semantic.VEHICLE),
)
profile = RenderProfile("test", 1.0, "{renderer}", samples=1, path_depth=1)
with SapienBackend().open(world, air_of(sky=uniform(1000.0), night={night}), profile) as renderer:
    renderer.place(frame_of())
    renderer.render_camera(view_of(pose_matrix((0.0, 0.0, 1.0)), size={size}))
"""


def read_with_includes(path: Path) -> str:
    return INCLUDE.sub(
        lambda found: read_with_includes(path.parent / found[1]), path.read_text(encoding="utf-8")
    )


@pytest.mark.parametrize("name", ["camera.rgen", "camera.rmiss", "shadow.rmiss"])
def test_only_hits_use_more_of_the_scene_than_where_its_triangles_are(name: str) -> None:
    """SAPIEN gives no other stage access to buffers and textures of the scene, its set 1."""
    text = read_with_includes(SHADER_FOLDER / "ray_traced" / name)
    assert set(re.findall(r"set = 1, binding = (\d+)", text)) <= {"0"}


@pytest.mark.render
@pytest.mark.skipif(not LAYER.exists(), reason="requires the package vulkan-validationlayers")
@pytest.mark.parametrize(
    ("renderer", "night", "size"),
    [
        ("raster", False, (64, 36)),
        ("raster", True, (64, 36)),
        ("raster", False, (1920, 1080)),
        ("ray_traced", False, (64, 36)),
        ("ray_traced", True, (64, 36)),
    ],
)
def test_the_validation_layer_finds_nothing(
    renderer: str, night: bool, size: tuple[int, int]
) -> None:
    done = subprocess.run(
        [sys.executable, "-c", SCRIPT.format(renderer=renderer, night=night, size=size)],
        capture_output=True,
        text=True,
        check=True,
        env={**os.environ, "VK_INSTANCE_LAYERS": "VK_LAYER_KHRONOS_validation"},
    )
    assert "VUID" not in done.stdout + done.stderr

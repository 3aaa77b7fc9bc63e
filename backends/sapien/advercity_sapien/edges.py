"""Smooths the edges of an image: draws its surfaces again, four in each pixel, tile by tile.

Light is computed once in a pixel, at its middle. Where samples around a middle show other surfaces,
each has the light of the nearest middles with the same surface. Tiles bound the memory.
"""

import math
from collections.abc import Callable, Iterator

import numpy as np
import sapien

from advercity.geometry.arrays import Float32Array
from advercity.rendering.backend import CameraView
from advercity_sapien.culling import PixelRect
from advercity_sapien.shader_constants import FAR_M, NEAR_M, SHADER_FOLDER

MAX_TILE_PX = 960 * 540
"""Most pixels of a tile without its margin, each of four samples."""
MARGIN_PX = 4
"""Reach of a pixel's samples in search of light (deferred.frag)."""
IMAGE_FORMATS = {"Paned": "R16G16B16A16Sfloat"}


class EdgeSmoother:
    """Draws surfaces at the middles, edges and corners of all pixels of images of one size."""

    def __init__(self, scene: sapien.Scene, width_px: int, height_px: int) -> None:
        self._scene = scene
        self._tiles = list(cut_into_tiles(width_px, height_px))
        tile = self._tiles[0]
        for name, texel in IMAGE_FORMATS.items():
            sapien.render.set_picture_format(name, texel)
        self._camera = sapien.render.RenderCameraComponent(
            2 * tile.width_px, 2 * tile.height_px, str(SHADER_FOLDER / "edges")
        )
        entity = sapien.Entity()
        entity.add_component(self._camera)
        scene.add_entity(entity)
        middles = np.zeros((height_px, width_px, 4), dtype=np.float32)
        self._middles = sapien.render.RenderTexture(middles, 2, "R32G32B32A32Sfloat")
        self._camera.set_texture("Middles", self._middles)

    def smooth(
        self, middles: Float32Array, view: CameraView, show: Callable[[PixelRect], None]
    ) -> Float32Array:
        """Compute the mean radiance of pixels (h, w, 4) from the one at their middles (h, w, 4).

        The fourth channel stays. `show` turns on the bodies of a part of the image.
        """
        self._middles.upload(middles)
        focal_px = view.width_px / (2.0 * math.tan(view.horizontal_fov_rad / 2.0))
        self._camera.entity.set_pose(sapien.Pose(view.world_from_camera))
        smooth = np.empty_like(middles)
        for tile in self._tiles:
            # The first sample of a pixel is its middle.
            self._camera.set_perspective_parameters(
                NEAR_M,
                FAR_M,
                2.0 * focal_px,
                2.0 * focal_px,
                view.width_px - 2.0 * tile.left_px - 0.5,
                view.height_px - 2.0 * tile.top_px - 0.5,
                0.0,
            )
            show(tile)
            self._scene.update_render()
            self._camera.take_picture()
            # The inside of later tiles is overwritten, so only margins before them are left out.
            found = self._camera.get_picture("Smooth")[: tile.height_px, : tile.width_px]
            top, left = (MARGIN_PX if edge else 0 for edge in (tile.top_px, tile.left_px))
            smooth[tile.top_px :, tile.left_px :][top : tile.height_px, left : tile.width_px] = (
                found[top:, left:]
            )
        return smooth


def cut_into_tiles(width_px: int, height_px: int) -> Iterator[PixelRect]:
    """Cut an image into parts of one size, overlapping by two margins or more."""
    count = math.ceil(math.sqrt(width_px * height_px / MAX_TILE_PX))
    width, height = (
        min(math.ceil(size / count) + 2 * MARGIN_PX, size) for size in (width_px, height_px)
    )
    for top in np.linspace(0, height_px - height, count).astype(int).tolist():
        for left in np.linspace(0, width_px - width, count).astype(int).tolist():
            yield PixelRect(left, top, width, height)

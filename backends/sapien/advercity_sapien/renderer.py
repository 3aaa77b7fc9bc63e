"""An open scene: cameras over a stage, behind the Renderer protocol."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import sapien
from numpy.typing import NDArray

from advercity.randomness import generator
from advercity.rendering.backend import CameraCapture, CameraView, Profile
from advercity.rendering.lamps import lit_lamps
from advercity.traffic.trace import Frame
from advercity.weather import puddles
from advercity.weather.atmosphere import Atmosphere
from advercity.world.scene import World
from advercity_sapien.beams_in_fog import NO_BEAMS, spread_rows
from advercity_sapien.bindings import Maps, RasterBindings, RayTracedBindings
from advercity_sapien.culling import seen_by
from advercity_sapien.denoising import denoised
from advercity_sapien.lamp_lists import LampLists
from advercity_sapien.shelter import NO_SHELTER, shelter_map
from advercity_sapien.stage import Stage
from advercity_sapien.sun import SunShadow
from advercity_sapien.tables import KILO, airlight_atlas, atmosphere_row, map_column, sky_atlas
from advercity_sapien.wear import wear_map

WEAR_COLUMN, GROUND_COLUMN, FRAME_COLUMN, SHELTER_COLUMN = 14, 15, 16, 17
SHADERS = Path(__file__).parent / "shaders"
NEAR_M, FAR_M = 0.1, 3000.0

Images = dict[str, NDArray[Any]]


class SapienRenderer:
    """Renders one world under one atmosphere."""

    def __init__(
        self, world: World, atmosphere: Atmosphere, profile: Profile, device: sapien.Device
    ) -> None:
        self._world = world
        self._profile = profile
        self._scene = sapien.Scene([sapien.render.RenderSystem(device)])
        self._is_ray_traced = profile.renderer == "ray_traced"
        self._is_denoised = self._is_ray_traced and profile.denoise
        wear = wear_map(world.lanes)
        shelter = shelter_map(world) if atmosphere.snow_depth_m else NO_SHELTER
        maps = Maps(
            sky_atlas(atmosphere),
            airlight_atlas(atmosphere),
            wear.texels,
            puddles.field(),
            shelter.texels,
        )
        self._bindings = (
            RayTracedBindings(self._scene, maps) if self._is_ray_traced else RasterBindings(maps)
        )
        self._stage = Stage(world, self._scene, self._bindings, night=atmosphere.night)
        self._sun = SunShadow(atmosphere, self._scene)
        self._cameras: dict[tuple[int, int], sapien.render.RenderCameraComponent] = {}
        self._begun: sapien.render.RenderCameraComponent | None = None
        self._air = atmosphere_row(atmosphere)
        self._air[WEAR_COLUMN] = map_column(wear)
        self._air[SHELTER_COLUMN] = map_column(shelter)
        self._atmosphere = atmosphere
        self._spread = spread_rows() if atmosphere.night else NO_BEAMS
        self._lamps = LampLists([], atmosphere)
        self._frame_index = 0

    def place(self, frame: Frame) -> None:
        """Move every actor to where it is in `frame`, and switch lamps and signals."""
        self._stage.place(frame)
        lit = lit_lamps(self._world, frame) if self._atmosphere.night else []
        self._lamps = LampLists(lit, self._atmosphere)
        self._air[GROUND_COLUMN] = self._lamps.ground
        self._air[FRAME_COLUMN, 3] = frame.index
        self._frame_index = frame.index

    def camera(self, view: CameraView) -> CameraCapture:
        """Take one picture of the placed frame."""
        return next(self.cameras([view]))

    def cameras(self, views: Sequence[CameraView]) -> Iterator[CameraCapture]:
        """Take pictures of the placed frame; the next is in the making while one is looked at.

        The device has begun with the first when this returns.
        """
        self._begin(views[0])
        return self._captures(views[1:])

    def _captures(self, views: Sequence[CameraView]) -> Iterator[CameraCapture]:
        for view in views:
            images = self._images()
            self._begin(view)
            yield self._capture(images)
        yield self._capture(self._images())

    def _begin(self, view: CameraView) -> None:
        """Set the device to work on a picture."""
        self._finish()
        camera = self._aimed(view)
        self._sun.follow(view)
        if not self._is_ray_traced:
            casting = self._sun.casting
            self._stage.culling.show([seen_by(view), *([] if casting is None else [casting])])
        with self._stage.without(view.hide):
            rows = self._air[None], self._lamps.rows(view), self._spread
            self._bindings.write(np.concatenate(rows))
            self._scene.update_render()
            camera.take_picture()
        self._begun = camera

    def _images(self) -> Images:
        """Everything of the picture that was begun, by name, as soon as the device is done."""
        assert self._begun is not None, "captures are fetched before the next are begun"
        names = ["Radiance", "Normal", "Segmentation"]
        if self._is_denoised:
            names.append("Albedo")
        images = {name: self._begun.get_picture(name) for name in names}
        self._begun = None
        return images

    def _finish(self) -> None:
        """Wait for a picture that nobody fetched: the device crashes if it is left at work."""
        if self._begun is not None:
            self._images()

    def _capture(self, images: Images) -> CameraCapture:
        radiance, depth = images["Radiance"][..., :3], images["Radiance"][..., 3]
        normal = np.ascontiguousarray(images["Normal"][..., :3])
        if self._is_denoised:
            radiance = denoised(radiance, images["Albedo"][..., :3], normal)
        semantic, instance = self._stage.identities.read(images["Segmentation"][..., 0])
        return CameraCapture(
            radiance=np.multiply(radiance, 1.0 / KILO, dtype=np.float32),
            depth=np.where(depth > 0.0, depth, np.float32(np.inf)),
            normal=normal,
            semantic=semantic,
            instance=instance,
        )

    def close(self) -> None:
        """Give the device's memory back."""
        self._finish()
        self._cameras.clear()
        self._scene.clear()

    def _aimed(self, view: CameraView) -> sapien.render.RenderCameraComponent:
        """The camera of the view's size, with its lens, pose and share of work."""
        size = view.width_px, view.height_px
        camera = self._cameras.get(size) or self._add_camera(size)
        focal_px = view.width_px / (2.0 * np.tan(view.horizontal_fov_rad / 2.0))
        camera.set_perspective_parameters(
            NEAR_M, FAR_M, focal_px, focal_px, view.width_px / 2, view.height_px / 2, 0.0
        )
        camera.entity.set_pose(sapien.Pose(view.world_from_camera))
        if self._is_ray_traced:
            camera.set_property("samples", self._profile.samples)
            camera.set_property("pathDepth", self._profile.path_depth)
            camera.set_property("seed", self._seed(view))
            camera.set_property("hiding", len(view.hide))
        return camera

    def _add_camera(self, size: tuple[int, int]) -> sapien.render.RenderCameraComponent:
        camera = sapien.render.RenderCameraComponent(*size, str(SHADERS / self._profile.renderer))
        entity = sapien.Entity()
        entity.add_component(camera)
        self._scene.add_entity(entity)
        self._bindings.bind(camera)
        self._cameras[size] = camera
        return camera

    def _seed(self, view: CameraView) -> int:
        """A number for this picture alone, whatever was rendered before it."""
        pose = view.world_from_camera.astype("<f8").tobytes().hex()
        key = "sapien", self._frame_index, view.width_px, view.height_px, pose
        return int(generator(*key).integers(2**31))

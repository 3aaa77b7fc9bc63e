"""Takes the noise of few samples out of a picture, on the CPU and the same way every time.

An open scene: cameras over a stage, behind the Renderer protocol.
"""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import sapien
from numpy.typing import NDArray

from advercity.frames import Frame
from advercity.geometry.arrays import Float32Array
from advercity.physics import water
from advercity.physics.atmosphere import Atmosphere
from advercity.randomness import create_generator
from advercity.rendering.backend import CameraCapture, CameraView, RenderProfile
from advercity.rendering.light_sources import list_light_sources
from advercity.world import World
from advercity_sapien.culling import SunShadow, compute_view_frustum
from advercity_sapien.fog_beams import EMPTY_FOG_BEAM_ROWS, compute_fog_beam_rows
from advercity_sapien.ground_maps import NO_SHELTER, build_shelter_map, build_wear_map
from advercity_sapien.lamp_lists import LampLists
from advercity_sapien.sapien_scene import SapienScene
from advercity_sapien.shader_bindings import RasterBindings, RayTracedBindings, SceneTextures
from advercity_sapien.shader_table import (
    FRAME_COLUMN,
    KILO,
    LAMP_GRID_COLUMN,
    SHELTER_MAP_COLUMN,
    WEAR_MAP_COLUMN,
    build_airlight_texture,
    build_sky_texture,
    pack_atmosphere,
    pack_map_extent,
)


def denoise(radiance: Float32Array, albedo: Float32Array, normal: Float32Array) -> Float32Array:
    """A picture (h, w, 3) of any scale by Intel's Open Image Denoise.

    Args:
        radiance: Linear, with noise.
        albedo: (h, w, 3) in [0, 1], without noise: where materials change.
        normal: (h, w, 3), unit, without noise: where shapes do.
    """
    # Its library takes a while to load, and only few pictures need it.
    import pyoidn

    return pyoidn.denoise(
        np.ascontiguousarray(radiance),
        albedo=np.ascontiguousarray(albedo),
        normal=np.ascontiguousarray(normal),
        hdr=True,
    )


SHADER_FOLDER = Path(__file__).parent / "shaders"
NEAR_M, FAR_M = 0.1, 3000.0

Images = dict[str, NDArray[Any]]


class SapienRenderer:
    """Renders one world under one atmosphere."""

    def __init__(
        self, world: World, atmosphere: Atmosphere, profile: RenderProfile, device: sapien.Device
    ) -> None:
        self._world = world
        self._profile = profile
        self._scene = sapien.Scene([sapien.render.RenderSystem(device)])
        self._is_ray_traced = profile.renderer == "ray_traced"
        self._is_denoised = self._is_ray_traced and profile.denoise
        wear = build_wear_map(world.lanes)
        shelter = build_shelter_map(world) if atmosphere.snow_depth_m else NO_SHELTER
        maps = SceneTextures(
            build_sky_texture(atmosphere),
            build_airlight_texture(atmosphere),
            wear.texels,
            water.build_puddle_height_field(),
            shelter.texels,
        )
        self._bindings = (
            RayTracedBindings(self._scene, maps) if self._is_ray_traced else RasterBindings(maps)
        )
        self._sapien_scene = SapienScene(world, self._scene, self._bindings, night=atmosphere.night)
        self._sun_shadow = SunShadow(atmosphere, self._scene)
        self._cameras: dict[tuple[int, int], sapien.render.RenderCameraComponent] = {}
        self._pending_camera: sapien.render.RenderCameraComponent | None = None
        self._parameters = pack_atmosphere(atmosphere)
        self._parameters[WEAR_MAP_COLUMN] = pack_map_extent(wear)
        self._parameters[SHELTER_MAP_COLUMN] = pack_map_extent(shelter)
        self._atmosphere = atmosphere
        self._fog_beams = compute_fog_beam_rows() if atmosphere.night else EMPTY_FOG_BEAM_ROWS
        self._lamps = LampLists([], atmosphere)
        self._frame_index = 0

    def place(self, frame: Frame) -> None:
        """Move every actor to where it is in `frame`, and switch lamps and signals."""
        self._sapien_scene.place_actors(frame)
        lit = list_light_sources(self._world, frame) if self._atmosphere.night else []
        self._lamps = LampLists(lit, self._atmosphere)
        self._parameters[LAMP_GRID_COLUMN] = self._lamps.cell_grid
        self._parameters[FRAME_COLUMN, 3] = frame.index
        self._frame_index = frame.index

    def render_camera(self, view: CameraView) -> CameraCapture:
        """Take one picture of the placed frame."""
        return next(self.render_cameras([view]))

    def render_cameras(self, views: Sequence[CameraView]) -> Iterator[CameraCapture]:
        """Take pictures of the placed frame; the next is in the making while one is looked at.

        The device has begun with the first when this returns.
        """
        self._start_render(views[0])
        return self._yield_captures(views[1:])

    def _yield_captures(self, views: Sequence[CameraView]) -> Iterator[CameraCapture]:
        for view in views:
            images = self._fetch_images()
            self._start_render(view)
            yield self._to_capture(images)
        yield self._to_capture(self._fetch_images())

    def _start_render(self, view: CameraView) -> None:
        """Set the device to work on a picture."""
        self._discard_pending()
        camera = self._configure_camera(view)
        self._sun_shadow.update(view)
        if not self._is_ray_traced:
            casting = self._sun_shadow.caster_volume
            self._sapien_scene.culler.show_only(
                [compute_view_frustum(view), *([] if casting is None else [casting])]
            )
        with self._sapien_scene.hide_actors(view.hide):
            rows = self._parameters[None], self._lamps.build_rows(view), self._fog_beams
            self._bindings.upload_table(np.concatenate(rows))
            self._scene.update_render()
            camera.take_picture()
        self._pending_camera = camera

    def _fetch_images(self) -> Images:
        """Everything of the picture that was begun, by name, as soon as the device is done."""
        assert self._pending_camera is not None, "captures are fetched before the next are begun"
        names = ["Radiance", "Normal", "Segmentation"]
        if self._is_denoised:
            names.append("Albedo")
        images = {name: self._pending_camera.get_picture(name) for name in names}
        self._pending_camera = None
        return images

    def _discard_pending(self) -> None:
        """Wait for a picture that nobody fetched: the device crashes if it is left at work."""
        if self._pending_camera is not None:
            self._fetch_images()

    def _to_capture(self, images: Images) -> CameraCapture:
        radiance, depth = images["Radiance"][..., :3], images["Radiance"][..., 3]
        normal = np.ascontiguousarray(images["Normal"][..., :3])
        if self._is_denoised:
            radiance = denoise(radiance, images["Albedo"][..., :3], normal)
        semantic, instance = self._sapien_scene.segmentation.look_up(images["Segmentation"][..., 0])
        return CameraCapture(
            radiance=np.multiply(radiance, 1.0 / KILO, dtype=np.float32),
            depth=np.where(depth > 0.0, depth, np.float32(np.inf)),
            normal=normal,
            semantic=semantic,
            instance=instance,
        )

    def close(self) -> None:
        """Give the device's memory back."""
        self._discard_pending()
        self._cameras.clear()
        self._scene.clear()

    def _configure_camera(self, view: CameraView) -> sapien.render.RenderCameraComponent:
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
            camera.set_property("seed", self._compute_seed(view))
            camera.set_property("hiding", len(view.hide))
        return camera

    def _add_camera(self, size: tuple[int, int]) -> sapien.render.RenderCameraComponent:
        camera = sapien.render.RenderCameraComponent(
            *size, str(SHADER_FOLDER / self._profile.renderer)
        )
        entity = sapien.Entity()
        entity.add_component(camera)
        self._scene.add_entity(entity)
        self._bindings.attach_to_camera(camera)
        self._cameras[size] = camera
        return camera

    def _compute_seed(self, view: CameraView) -> int:
        """A number for this picture alone, whatever was rendered before it."""
        pose = view.world_from_camera.astype("<f8").tobytes().hex()
        key = "sapien", self._frame_index, view.width_px, view.height_px, pose
        return int(create_generator(*key).integers(2**31))

"""Renders an open scene through SAPIEN, behind the core's Renderer protocol."""

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
import sapien
from numpy.typing import NDArray

from advercity.frames import Frame
from advercity.physics import water
from advercity.physics.atmosphere import Atmosphere
from advercity.randomness import create_generator
from advercity.rendering.backend import CameraCapture, CameraView, RenderProfile
from advercity.rendering.denoising import denoise
from advercity.rendering.fog_beams import compute_fog_beams
from advercity.rendering.ground_maps import (
    NO_SHELTER,
    build_shelter_map,
    build_wear_map,
    needs_shelter_map,
)
from advercity.rendering.light_sources import list_light_sources
from advercity.world import World
from advercity_sapien.atmosphere_parameters import (
    build_airlight_texture,
    build_sky_texture,
    compute_air_parameters,
    compute_light_parameters,
)
from advercity_sapien.contact_map import ContactMap
from advercity_sapien.culling import PixelRect, SunShadow, compute_view_frustum
from advercity_sapien.edges import EdgeSmoother
from advercity_sapien.lamp_lists import LampLists
from advercity_sapien.lamp_shadows import NO_SHADOWS, LampShadows
from advercity_sapien.light_probes import NO_PROBES, LightProbes, bake_light_probes
from advercity_sapien.sapien_scene import SapienScene
from advercity_sapien.shader_bindings import RasterBindings, RayTracedBindings
from advercity_sapien.shader_constants import FAR_M, NEAR_M, SHADER_FOLDER
from advercity_sapien.shader_table import KILO, SceneTexels, ShaderTable
from advercity_sapien.skylines import build_skyline_texture

Images = dict[str, NDArray[Any]]
COMPACT_IMAGES = {
    "Shape": "R16G16B16A16Uint",
    **dict.fromkeys(
        ("Colour", "Facing", "Relief", "Mirror", "Ambient", "Reflex", "Glow"), "R16G16B16A16Sfloat"
    ),
    **dict.fromkeys(("Levels", "Spread"), "R16G16B16A16Sfloat"),
}
"""Formats of the raster pack's images without single precision; SAPIEN gives every image 16
bytes a texel. A format holds for a name in all packs, so the ray-traced one has other names."""
MAX_RASTER_SAMPLES = 960 * 540 * 4
"""Most samples of surfaces drawn at once, to save memory; larger images: see `edges`."""


FINEST_M = 1e-3
"""Width of a pixel at a metre of an image 1920 pixels and 90 degrees wide; cameras see nothing
nearer."""


class SapienRenderer:
    """Renders one world under an atmosphere, which may change."""

    def __init__(
        self, world: World, atmosphere: Atmosphere, profile: RenderProfile, device: sapien.Device
    ) -> None:
        self._world, self._profile, self._device = world, profile, device
        self._is_ray_traced = profile.renderer == "ray_traced"
        self._is_denoised = self._is_ray_traced and profile.denoise
        self._open_scene(atmosphere)

    def _open_scene(self, atmosphere: Atmosphere) -> None:
        world = self._world
        self._atmosphere = atmosphere
        self._scene = sapien.Scene([sapien.render.RenderSystem(self._device)])
        wear = build_wear_map(world.lanes)
        has_shelter = needs_shelter_map(world, atmosphere)
        shelter = build_shelter_map(world) if has_shelter else NO_SHELTER
        self._probes = self._bake_probes(atmosphere)
        self._contact = ContactMap(world, self._probes)
        has_shadows = atmosphere.night and not self._is_ray_traced
        self._lamp_shadows = LampShadows(world) if has_shadows else None
        maps = {
            **self._build_light_maps(atmosphere),
            "Wear": wear.texels,
            "Puddles": water.build_puddle_height_field(),
            "Shelter": shelter.texels,
            "Contact": self._contact.texels,
            "LampReach": self._lamp_shadows.texels if self._lamp_shadows else NO_SHADOWS,
        }
        # Before the scene: the shaders look for the textures in its first object.
        self._bindings = (
            RayTracedBindings(self._scene, maps) if self._is_ray_traced else RasterBindings(maps)
        )
        self._sapien_scene = SapienScene(
            world,
            self._scene,
            self._bindings,
            night=atmosphere.night,
            finest_m=FINEST_M / self._profile.scale,
            has_distant_pieces=not self._is_ray_traced,
            frees_poses=not self._is_ray_traced,
        )
        self._sun_shadow = SunShadow(atmosphere, self._scene)
        self._cameras: dict[tuple[int, int], sapien.render.RenderCameraComponent] = {}
        self._smoothers: dict[tuple[int, int], EdgeSmoother] = {}
        self._pending: tuple[sapien.render.RenderCameraComponent, CameraView] | None = None
        self._table = ShaderTable()
        self._table.set_parameters(
            **compute_air_parameters(atmosphere),
            wear_map_extent=wear.extent,
            shelter_map_extent=shelter.extent,
        )
        self._write_light_parameters(atmosphere)
        self._write_fog_beams(atmosphere)
        self._lamps = LampLists([], atmosphere)
        self._frame_index = 0

    def change_atmosphere(self, atmosphere: Atmosphere) -> None:
        """Replace air and light; skies and probes are made again only if the light changes.

        The scene is opened again if lights or sizes of textures change, as between day and night:
        SAPIEN cannot change them.
        """
        before = self._atmosphere
        if _find_scene_features(atmosphere) != _find_scene_features(before):
            self.close()
            self._open_scene(atmosphere)
            return
        self._discard_pending()
        self._atmosphere = atmosphere
        self._table.set_parameters(**compute_air_parameters(atmosphere))
        self._write_fog_beams(atmosphere)
        if atmosphere.sky is not before.sky:
            self._probes = self._bake_probes(atmosphere)
            self._bindings.upload_maps(self._build_light_maps(atmosphere))
            self._sun_shadow.follow_sun(atmosphere)
            self._write_light_parameters(atmosphere)

    def _bake_probes(self, atmosphere: Atmosphere) -> LightProbes:
        return NO_PROBES if self._is_ray_traced else bake_light_probes(self._world, atmosphere)

    def _build_light_maps(self, atmosphere: Atmosphere) -> SceneTexels:
        return {
            "Sky": build_sky_texture(atmosphere),
            "Airlight": build_airlight_texture(atmosphere),
            "ProbeLight": self._probes.light,
            "ProbeFirst": self._probes.shape[0],
            "ProbeSecond": self._probes.shape[1],
            "SkylineLight": build_skyline_texture(self._probes.skylines),
            "SkylineNearness": self._probes.skylines.nearness,
        }

    def _write_light_parameters(self, atmosphere: Atmosphere) -> None:
        self._table.set_parameters(
            **compute_light_parameters(atmosphere),
            probe_map_extent=self._probes.extent,
            probe_open_shape=self._probes.open_shape.reshape(2, 4),
        )

    def _write_fog_beams(self, atmosphere: Atmosphere) -> None:
        if atmosphere.night:
            self._table.set_fog_beams(compute_fog_beams(atmosphere.extinction.at_550nm))

    def place(self, frame: Frame) -> None:
        """Move every actor to its pose in `frame`, and switch lamps and signals."""
        self._discard_pending()
        self._sapien_scene.place_actors(frame)
        lamps = list_light_sources(self._world, frame) if self._atmosphere.night else []
        self._lamps = LampLists(lamps, self._atmosphere)
        self._frame_index = frame.index
        self._contact.place(frame)
        self._bindings.upload_maps({"Contact": self._contact.texels})
        if self._lamp_shadows is not None:
            self._lamp_shadows.place(frame, self._lamps.lamps)
            self._bindings.upload_maps({"LampReach": self._lamp_shadows.texels})
        self._table.set_parameters(lamp_grid=self._lamps.cell_grid, frame_index=frame.index)

    def render_camera(self, view: CameraView) -> CameraCapture:
        """Render one image of the placed frame."""
        return next(self.render_cameras([view]))

    def render_cameras(self, views: Sequence[CameraView]) -> Iterator[CameraCapture]:
        """Render images of the placed frame; while the caller uses one, the next is rendered.

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
        self._discard_pending()
        camera = self._configure_camera(view)
        self._sun_shadow.update(view)
        if not self._is_ray_traced:
            volumes = [compute_view_frustum(view), *self._sun_shadow.caster_volumes]
            self._sapien_scene.culler.show_only(volumes, view)
        with self._sapien_scene.hide_actors(view.hide):
            self._lamps.write_to(self._table, view)
            self._bindings.upload_table(self._table)
            self._scene.update_render()
            camera.take_picture()
        self._pending = camera, view

    def _fetch_images(self) -> Images:
        """Wait for the image in progress, and copy its channels by name."""
        images, view = self._wait_for_images()
        if not self._is_ray_traced and self._count_samples_per_axis(view) == 1:
            images["Radiance"] = self._smooth_edges(images["Radiance"], view)
        return images

    def _wait_for_images(self) -> tuple[Images, CameraView]:
        """Wait for the image in progress; return its channels by name, and its view."""
        assert self._pending is not None, "captures are fetched before the next are begun"
        camera, view = self._pending
        self._pending = None
        names = ["Normal", "Segmentation"] if self._is_ray_traced else ["Facing", "Shape"]
        if self._is_denoised:
            names.append("Albedo")
        samples = self._count_samples_per_axis(view)
        images = {name: camera.get_picture(name)[::samples, ::samples] for name in names}
        if not self._is_ray_traced:
            images["Normal"] = images["Facing"].astype(np.float32)
            # Halves of 32 bits.
            images["Segmentation"] = np.ascontiguousarray(images["Shape"]).view(np.uint32)
        images["Radiance"] = camera.get_picture("Radiance")[: view.height_px, : view.width_px]
        return images, view

    def _smooth_edges(self, middles: NDArray[np.float32], view: CameraView) -> NDArray[np.float32]:
        """Compute mean radiance and depth (h, w, 4) of pixels from values at their middles."""
        size = view.width_px, view.height_px
        if size not in self._smoothers:
            self._smoothers[size] = EdgeSmoother(self._scene, *size)

        def show(part: PixelRect) -> None:
            frustum = compute_view_frustum(view, part)
            self._sapien_scene.culler.show_only([frustum], view)

        with self._sapien_scene.hide_actors(view.hide):
            return self._smoothers[size].smooth(middles, view, show)

    def _discard_pending(self) -> None:
        """Wait for an image not fetched: SAPIEN crashes if it is closed or reused."""
        if self._pending is not None:
            self._wait_for_images()

    def _to_capture(self, images: Images) -> CameraCapture:
        radiance, depth = images["Radiance"][..., :3], images["Radiance"][..., 3]
        normal = np.ascontiguousarray(images["Normal"][..., :3])
        if self._is_denoised:
            radiance = denoise(radiance, images["Albedo"][..., :3], normal)
        semantic, instance = self._sapien_scene.segmentation.look_up(images["Segmentation"][..., 0])
        return CameraCapture(
            radiance=np.multiply(radiance, 1.0 / KILO, dtype=np.float32),
            # Shaders write a depth of 0 where they see the sky.
            depth=np.where(depth > 0.0, depth, np.float32(np.inf)),
            normal=normal,
            semantic=semantic,
            instance=instance,
        )

    def close(self) -> None:
        """Free the device's memory."""
        self._discard_pending()
        self._cameras.clear()
        self._smoothers.clear()
        self._scene.clear()

    def _configure_camera(self, view: CameraView) -> sapien.render.RenderCameraComponent:
        """Set lens, pose and quality of the camera with the view's size."""
        samples = self._count_samples_per_axis(view)
        size = width, height = view.width_px * samples, view.height_px * samples
        camera = self._cameras.get(size) or self._add_camera(size)
        focal = width / (2.0 * np.tan(view.horizontal_fov_rad / 2.0))
        # The first sample of a pixel is its middle (pixel_samples.glsl).
        shift = 0.5 * (samples - 1)
        camera.set_perspective_parameters(
            NEAR_M, FAR_M, focal, focal, 0.5 * width - shift, 0.5 * height - shift, 0.0
        )
        camera.entity.set_pose(sapien.Pose(view.world_from_camera))
        if self._is_ray_traced:
            camera.set_property("samples", self._profile.samples)
            camera.set_property("pathDepth", self._profile.path_depth)
            camera.set_property("seed", self._compute_seed(view))
            camera.set_property("hiding", len(view.hide))
        return camera

    def _count_samples_per_axis(self, view: CameraView) -> int:
        """Count the samples of surfaces along the edge of a pixel."""
        samples = 4 * view.width_px * view.height_px
        return 1 if self._is_ray_traced or samples > MAX_RASTER_SAMPLES else 2

    def _add_camera(self, size: tuple[int, int]) -> sapien.render.RenderCameraComponent:
        for name, texel in COMPACT_IMAGES.items():
            sapien.render.set_picture_format(name, texel)
        shaders = str(SHADER_FOLDER / self._profile.renderer)
        camera = sapien.render.RenderCameraComponent(*size, shaders)
        entity = sapien.Entity()
        entity.add_component(camera)
        self._scene.add_entity(entity)
        self._bindings.attach_to_camera(camera)
        self._cameras[size] = camera
        return camera

    def _compute_seed(self, view: CameraView) -> int:
        """Derive a seed from frame and view alone: no image depends on the one before."""
        pose = view.world_from_camera.astype("<f8").tobytes().hex()
        key = "sapien", self._frame_index, view.width_px, view.height_px, pose
        return int(create_generator(*key).integers(2**31))


def _find_scene_features(atmosphere: Atmosphere) -> tuple[bool, ...]:
    """Find the inputs of a scene's set of lights and its textures' sizes."""
    return (
        atmosphere.night,
        atmosphere.is_dark,
        atmosphere.sun_lx > 0.0,
        atmosphere.clouds is not None,
        atmosphere.snow_depth_m > 0.0,
    )

"""Renders an open scene through Mitsuba, behind the core's Renderer protocol."""

from collections.abc import Iterator, Sequence

import numpy as np

from advercity.frames import Frame
from advercity.physics.atmosphere import Atmosphere
from advercity.randomness import create_generator
from advercity.rendering.backend import CameraCapture, CameraView, RenderProfile
from advercity.rendering.denoising import denoise
from advercity.rendering.light_sources import list_light_sources
from advercity.semantics import Semantic
from advercity.world import World
from advercity_mitsuba.camera import build_camera, trace_guides
from advercity_mitsuba.detail import build_octave_table
from advercity_mitsuba.geometry import GeometryStore
from advercity_mitsuba.hits import Scene
from advercity_mitsuba.images import DeviceImages, upload_images
from advercity_mitsuba.lamps import LampSet
from advercity_mitsuba.light import KILO, upload_light
from advercity_mitsuba.paths import trace_radiance
from advercity_mitsuba.placement import FramePlacer
from advercity_mitsuba.surfaces import SurfaceTable
from advercity_mitsuba.variant import activate_variant, dr, mi
from advercity_mitsuba.weathering import GroundMaps, build_weather_tables

RASTER_SAMPLES, RASTER_PATH_DEPTH = 4, 3
"""Samples of a pixel, and bounces, under raster profiles."""


class MitsubaRenderer:
    """Renders one world under a changeable atmosphere."""

    def __init__(self, world: World, atmosphere: Atmosphere, profile: RenderProfile) -> None:
        activate_variant()
        self._world, self._profile = world, profile
        self._surfaces = SurfaceTable(world.material_maps)
        self._store = GeometryStore(self._surfaces)
        self._placer = FramePlacer(world, self._store)
        self._ground = GroundMaps(world)
        self._octaves = build_octave_table()
        self._images: DeviceImages | None = None
        self._image_count = -1
        self._atmosphere = atmosphere
        self._light = upload_light(atmosphere)

    def change_atmosphere(self, atmosphere: Atmosphere) -> None:
        """Replace the air and light of all frames placed from now on."""
        activate_variant()
        self._atmosphere = atmosphere
        self._light = upload_light(atmosphere)

    def place(self, frame: Frame) -> None:
        """Move every actor to its pose in `frame`, and switch lamps and signals."""
        activate_variant()
        atmosphere = self._atmosphere
        self._frame_index = frame.index
        self._placed = self._placer.place(frame, night=atmosphere.night)
        lamps = list_light_sources(self._world, frame) if atmosphere.night else []
        self._lamps = LampSet(lamps, atmosphere, self._light) if lamps else None
        self._weather = build_weather_tables(self._ground, atmosphere, frame.index)

    def render_camera(self, view: CameraView) -> CameraCapture:
        """Render one image of the placed frame."""
        activate_variant()
        scene, camera = self._build_scene(view), build_camera(view)
        is_raster = self._profile.renderer == "raster"
        pixel = dr.arange(mi.UInt32, view.width_px * view.height_px)
        guides = trace_guides(scene, camera, pixel)
        radiance, lenses = trace_radiance(
            scene,
            camera,
            pixel,
            samples=dr.opaque(mi.UInt32, RASTER_SAMPLES if is_raster else self._profile.samples),
            path_depth=dr.opaque(
                mi.UInt32, RASTER_PATH_DEPTH if is_raster else self._profile.path_depth
            ),
            seed=dr.opaque(mi.UInt32, self._compute_seed(view)),
        )
        dr.eval(radiance, lenses)
        size = view.height_px, view.width_px
        light = np.array(radiance, np.float32).T.reshape(*size, 3)
        normal = np.array(guides.normal, np.float32).T.reshape(*size, 3)
        if is_raster or self._profile.denoise:
            albedo = np.array(guides.albedo, np.float32).T.reshape(*size, 3)
            # The denoiser would draw outlines of fogged surfaces into the glow of lamps.
            clear = np.array(guides.clearness, np.float32).reshape(*size, 1)
            veiled = 1.0 + clear * (albedo - 1.0), clear * normal
            light = denoise(light, *(guide.astype(np.float32) for guide in veiled))
        # Lenses have no noise, and the denoiser would smear them into the darker pixels around.
        light = light + np.array(lenses, np.float32).T.reshape(*size, 3)
        depth = np.array(guides.depth, np.float32).reshape(size)
        semantic = np.array(guides.semantic, np.uint8).reshape(size)
        return CameraCapture(
            radiance=np.multiply(light, 1.0 / KILO, dtype=np.float32),
            depth=np.where(depth > 0.0, depth, np.float32(np.inf)),
            normal=np.ascontiguousarray(normal),
            semantic=np.where(depth > 0.0, semantic, np.uint8(Semantic.SKY)),
            instance=np.array(guides.actor).astype(np.int32).reshape(size),
        )

    def render_cameras(self, views: Sequence[CameraView]) -> Iterator[CameraCapture]:
        """Render images of the placed frame, in order."""
        return map(self.render_camera, views)

    def _build_scene(self, view: CameraView) -> Scene:
        return Scene(
            placed=self._placed,
            tables=self._store.tables,
            images=self._get_images(),
            octaves=self._octaves,
            light=self._light,
            weather=self._weather,
            lamps=None if self._lamps is None else self._lamps.tables,
            glow_chances=None if self._lamps is None else self._lamps.build_glow_chances(view),
            hidden=self._placed.find_hidden(view.hide),
        )

    def _get_images(self) -> DeviceImages:
        names = self._surfaces.map_names
        if self._images is None or self._image_count != len(names):
            self._images = upload_images(self._world.material_maps, names)
            self._image_count = len(names)
        return self._images

    def _compute_seed(self, view: CameraView) -> int:
        """Derive a seed from frame and view alone: no image depends on the one before."""
        pose = view.world_from_camera.astype("<f8").tobytes().hex()
        key = "mitsuba", self._frame_index, view.width_px, view.height_px, pose
        return int(create_generator(*key).integers(2**31))

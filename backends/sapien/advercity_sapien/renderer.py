"""An open scene: SAPIEN's entities, cameras and tables behind the Renderer protocol."""

from collections.abc import Generator, Iterable
from contextlib import contextmanager
from pathlib import Path
from typing import Literal

import numpy as np
import sapien
from numpy.typing import NDArray

from advercity.rendering.backend import CameraCapture, CameraView, Profile
from advercity.semantics import Semantic
from advercity.traffic.trace import Actor, Frame
from advercity.weather.atmosphere import Atmosphere
from advercity.world.scene import World
from advercity_sapien.shapes import ShapeLibrary
from advercity_sapien.tables import COLUMNS, KILO, atmosphere_row, sky_atlas

SHADERS = Path(__file__).parent / "shaders"
NEAR_M, FAR_M = 0.05, 3000.0
SHADOW_HALF_SIZE_M, SHADOW_RANGE_M, SHADOW_TEXELS = 60.0, 400.0, 2048
PARKED = sapien.Pose([0.0, 0.0, -1e4])
"""Where actors wait while they are not in the frame: far below anything visible."""
PICTURE_FORMAT = "R32G32B32A32Sfloat"
"""SAPIEN's name of four 32-bit floats a texel."""


class SapienRenderer:
    """Renders one world under one atmosphere."""

    def __init__(
        self, world: World, atmosphere: Atmosphere, profile: Profile, device: sapien.Device
    ) -> None:
        self._world = world
        self._pack = SHADERS / profile.renderer
        self._system = sapien.render.RenderSystem(device)
        self._scene = sapien.Scene([self._system])
        self._shapes = ShapeLibrary()
        self._identities = Identities()
        self._actors: dict[int, sapien.render.RenderBodyComponent] = {}
        self._cameras: dict[tuple[int, int], sapien.render.RenderCameraComponent] = {}
        self._table = np.zeros((2, COLUMNS, 4), dtype=np.float32)
        self._table[0] = atmosphere_row(atmosphere)
        self._table_texture = _texture(self._table, filter_mode="nearest")
        self._sky_texture = _texture(sky_atlas(atmosphere), filter_mode="linear")
        self._world_from_sun = _looking(-atmosphere.sun_direction)
        self._sun = _sun(atmosphere)
        if self._sun is not None:
            self._add("sun", self._sun)
        self._add_static()

    def place(self, frame: Frame) -> None:
        """Move every actor to where it is in `frame`, and switch lamps and signals."""
        present = {state.actor.id: state for state in frame.states}
        for state in frame.states:
            body = self._actors.get(state.actor.id) or self._add_actor(state.actor)
            body.entity.set_pose(sapien.Pose(state.world_from_body))
            body.set_property("lit", int(state.lamps))
        for actor_id in self._actors.keys() - present.keys():
            self._actors[actor_id].entity.set_pose(PARKED)

    def camera(self, view: CameraView) -> CameraCapture:
        """Take one picture of the placed frame."""
        camera = self._camera(view)
        self._aim_sun(view)
        with self._hidden(view.hide):
            self._scene.update_render()
            camera.take_picture()
        radiance = camera.get_picture("Radiance")
        depth = radiance[..., 3]
        ids = camera.get_picture("Segmentation")[..., 0]
        return CameraCapture(
            radiance=np.multiply(radiance[..., :3], 1.0 / KILO, dtype=np.float32),
            depth=np.where(depth > 0.0, depth, np.float32(np.inf)),
            normal=np.ascontiguousarray(camera.get_picture("Normal")[..., :3]),
            semantic=self._identities.semantic[ids],
            instance=self._identities.actor[ids],
        )

    def close(self) -> None:
        """Give the device's memory back."""
        self._scene.clear()
        self._actors.clear()
        self._cameras.clear()

    def _add(self, name: str, component: sapien.Component) -> None:
        entity = sapien.Entity()
        entity.set_name(name)
        entity.add_component(component)
        self._scene.add_entity(entity)

    def _add_body(
        self,
        name: str,
        shapes: Iterable[tuple[sapien.render.RenderShape, Semantic]],
        actor_id: int,
    ) -> sapien.render.RenderBodyComponent:
        body = sapien.render.RenderBodyComponent()
        labels: list[Semantic] = []
        for shape, semantic in shapes:
            body.attach(shape)
            labels.append(semantic)
        self._add(name, body)
        body.set_property("lit", 0)
        for shape, semantic in zip(body.render_shapes, labels, strict=True):
            self._identities.learn(shape.per_scene_id, semantic, actor_id)
        return body

    def _add_static(self) -> None:
        shapes = (
            (shape, mesh.semantic)
            for mesh in self._world.static
            for shape in self._shapes.of_mesh(mesh)
        )
        self._add_body("static", shapes, actor_id=0)

    def _add_actor(self, actor: Actor) -> sapien.render.RenderBodyComponent:
        shapes = self._shapes.of_body(self._world.bodies[actor.blueprint], actor.paint)
        self._actors[actor.id] = self._add_body(f"actor {actor.id}", shapes, actor.id)
        return self._actors[actor.id]

    def _camera(self, view: CameraView) -> sapien.render.RenderCameraComponent:
        size = view.width_px, view.height_px
        if size not in self._cameras:
            camera = sapien.render.RenderCameraComponent(*size, str(self._pack))
            self._add(f"camera {size}", camera)
            camera.set_texture("Table", self._table_texture)
            camera.set_texture("Sky", self._sky_texture)
            self._cameras[size] = camera
        camera = self._cameras[size]
        focal_px = view.width_px / (2.0 * np.tan(view.horizontal_fov_rad / 2.0))
        camera.set_perspective_parameters(
            NEAR_M, FAR_M, focal_px, focal_px, view.width_px / 2, view.height_px / 2, 0.0
        )
        camera.entity.set_pose(sapien.Pose(view.world_from_camera))
        return camera

    def _aim_sun(self, view: CameraView) -> None:
        """Centre the shadow map on what the camera sees, in whole texels so that it is still."""
        if self._sun is None:
            return
        ahead = view.world_from_camera[:3, 3] + view.world_from_camera[:3, 0] * (
            SHADOW_HALF_SIZE_M * 0.6
        )
        texel = 2.0 * SHADOW_HALF_SIZE_M / SHADOW_TEXELS
        in_light = np.round(self._world_from_sun.T @ ahead / texel) * texel
        in_light[0] -= SHADOW_RANGE_M / 2.0
        matrix = np.eye(4)
        matrix[:3, :3] = self._world_from_sun
        matrix[:3, 3] = self._world_from_sun @ in_light
        self._sun.entity.set_pose(sapien.Pose(matrix))

    @contextmanager
    def _hidden(self, actor_ids: frozenset[int]) -> Generator[None, None, None]:
        bodies = [self._actors[actor_id] for actor_id in actor_ids if actor_id in self._actors]
        for body in bodies:
            body.visibility = 0.0
        try:
            yield
        finally:
            for body in bodies:
                body.visibility = 1.0


class Identities:
    """What each of SAPIEN's shape ids stands for; id 0 is the sky."""

    def __init__(self) -> None:
        self.semantic = np.full(64, Semantic.SKY, dtype=np.uint8)
        self.actor = np.zeros(64, dtype=np.int32)

    def learn(self, shape_id: int, semantic: Semantic, actor_id: int) -> None:
        """Remember a shape."""
        if shape_id >= len(self.actor):
            room = max(shape_id + 1 - len(self.actor), len(self.actor))
            self.semantic = np.pad(self.semantic, (0, room))
            self.actor = np.pad(self.actor, (0, room))
        self.semantic[shape_id] = semantic
        self.actor[shape_id] = actor_id


def _looking(direction: NDArray[np.float64]) -> NDArray[np.float64]:
    """Rotation (3, 3) of a body whose x axis points along a unit direction."""
    forward = np.asarray(direction, dtype=np.float64)
    aside = np.array([0.0, 0.0, 1.0]) if abs(forward[2]) < 0.9 else np.array([1.0, 0.0, 0.0])
    left = np.cross(aside, forward)
    left /= np.linalg.norm(left)
    return np.stack([forward, left, np.cross(forward, left)], axis=1)


def _sun(atmosphere: Atmosphere) -> sapien.render.RenderDirectionalLightComponent | None:
    """The light that casts shadows, or None where there is no direct sun."""
    if atmosphere.sun_lx <= 0.0:
        return None
    sun = sapien.render.RenderDirectionalLightComponent()
    sun.shadow = True
    sun.shadow_near, sun.shadow_far = 0.0, SHADOW_RANGE_M
    sun.shadow_half_size = SHADOW_HALF_SIZE_M
    sun.shadow_map_size = SHADOW_TEXELS
    return sun


def _texture(
    texels: NDArray[np.float32], *, filter_mode: Literal["nearest", "linear"]
) -> sapien.render.RenderTexture:
    return sapien.render.RenderTexture(
        texels, 2, PICTURE_FORMAT, filter_mode=filter_mode, address_mode="edge"
    )

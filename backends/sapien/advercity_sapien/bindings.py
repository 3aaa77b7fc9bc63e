"""What the shaders need to know beyond the scene, and how each kind of pack gets at it."""

from typing import Protocol

import numpy as np
import sapien
from numpy.typing import NDArray

from advercity_sapien.tables import COLUMNS
from advercity_sapien.wear import WearMap

FORMAT = "R32G32B32A32Sfloat"
"""SAPIEN's name for four 32-bit floats a texel."""
BYTE = "R8Unorm"
BODY_ROWS = 16
"""Of the ray tracer's table, for the states of as many times COLUMNS bodies."""


class Bindings(Protocol):
    """The table of air and lamps, the sky, and the state of every body."""

    def bind(self, camera: sapien.render.RenderCameraComponent) -> None:
        """Let a new camera see them."""
        ...

    def mark(self, body: sapien.render.RenderBodyComponent, lit: int, *, hidden: bool) -> None:
        """Say which lenses of a body shine (bits in `lenses.glsl`), and whether it is hidden."""
        ...

    def write(self, table: NDArray[np.float32]) -> None:
        """Replace the table's rows (2, COLUMNS, 4), for the pictures to come."""
        ...


class RasterBindings:
    """Table and sky are textures of each camera, states are properties of the bodies."""

    def __init__(self, sky: NDArray[np.float32], wear: WearMap) -> None:
        empty = np.zeros((2, COLUMNS, 4), dtype=np.float32)
        self._table = sapien.render.RenderTexture(empty, 2, FORMAT, address_mode="edge")
        self._sky = sapien.render.RenderTexture(sky, 2, FORMAT, address_mode="edge")
        self._wear = sapien.render.RenderTexture(wear.texels, 2, BYTE, address_mode="edge")

    def bind(self, camera: sapien.render.RenderCameraComponent) -> None:
        """Let a new camera see table, sky and wear."""
        camera.set_texture("Table", self._table)
        camera.set_texture("Sky", self._sky)
        camera.set_texture("Wear", self._wear)

    def mark(self, body: sapien.render.RenderBodyComponent, lit: int, *, hidden: bool) -> None:
        """Say which lenses of a body shine (bits in `lenses.glsl`), and whether it is hidden."""
        body.set_property("lit", lit)
        body.set_property("hidden", int(hidden))

    def write(self, table: NDArray[np.float32]) -> None:
        """Replace the table, for the pictures to come."""
        self._table.upload(table)


class RayTracedBindings:
    """All travels in the material of the scene's first object, with the states below the table.

    SAPIEN's ray-tracing packs see no textures of cameras and no properties of bodies.
    """

    def __init__(self, scene: sapien.Scene, sky: NDArray[np.float32], wear: WearMap) -> None:
        self._rows = np.zeros((2 + BODY_ROWS, COLUMNS, 4), dtype=np.float32)
        self._states = self._rows[2:].reshape(-1, 4)
        self._table = sapien.render.RenderTexture2D(self._rows, FORMAT, address_mode="edge")
        material = sapien.render.RenderMaterial()
        material.base_color_texture = self._table
        material.emission_texture = sapien.render.RenderTexture2D(sky, FORMAT, address_mode="edge")
        material.roughness_texture = sapien.render.RenderTexture2D(
            wear.texels, BYTE, address_mode="edge"
        )
        carrier = sapien.render.RenderBodyComponent()
        carrier.attach(sapien.render.RenderShapeBox([0.01, 0.01, 0.01], material))
        entity = sapien.Entity()
        entity.add_component(carrier)
        entity.set_pose(sapien.Pose([0.0, 0.0, -2e4]))
        scene.add_entity(entity)

    def bind(self, camera: sapien.render.RenderCameraComponent) -> None:
        """Every camera sees the scene's materials."""

    def mark(self, body: sapien.render.RenderBodyComponent, lit: int, *, hidden: bool) -> None:
        """Say which lenses of a body shine (bits in `lenses.glsl`), and whether it is hidden."""
        self._states[body.entity.per_scene_id, :2] = lit, hidden

    def write(self, table: NDArray[np.float32]) -> None:
        """Replace the table, for the pictures to come."""
        self._rows[:2] = table
        self._table.upload(self._rows)

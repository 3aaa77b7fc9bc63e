"""What the shaders need to know beyond the scene, and how each kind of pack gets at it."""

from dataclasses import dataclass
from typing import Any, Literal, Protocol

import numpy as np
import sapien
from numpy.typing import NDArray

from advercity.errors import BackendError
from advercity_sapien.shader_table import BODY_STATE_ROWS, COLUMNS, TABLE_ROWS

RGBA_FLOAT = "R32G32B32A32Sfloat"
"""SAPIEN's name for four 32-bit floats a texel."""
RG_FLOAT, R_FLOAT, R_UNORM8 = "R32G32Sfloat", "R32Sfloat", "R8Unorm"


@dataclass(frozen=True, eq=False)
class SceneTextures:
    """What never changes while a scene is open, as texels (h, w) or (h, w, channels).

    Attributes:
        sky: The sky's faces below each other, four float32.
        airlight: Those of the airlight, four float32.
        wear: Of carriageways, one byte, with what `tables.map_column` says of it.
        puddles: Heights of `advercity.weather.puddles.field`, one float32.
        shelter: Of `ShelterMap`, two float32.
    """

    sky: NDArray[np.float32]
    airlight: NDArray[np.float32]
    wear: NDArray[np.uint8]
    puddles: NDArray[np.float32]
    shelter: NDArray[np.float32]


class ShaderBindings(Protocol):
    """The table of air and lamps, the maps, and the state of every body."""

    def attach_to_camera(self, camera: sapien.render.RenderCameraComponent) -> None:
        """Let a new camera see them."""
        ...

    def set_body_state(
        self, body: sapien.render.RenderBodyComponent, lamp_bits: int, *, hidden: bool
    ) -> None:
        """Say which lenses of a body shine (bits in `lenses.glsl`), and whether it is hidden."""
        ...

    def upload_table(self, table: NDArray[np.float32]) -> None:
        """Replace the table's rows (TABLE_ROWS, COLUMNS, 4), for the pictures to come."""
        ...


class RasterBindings:
    """Table and maps are textures of each camera, states are properties of the bodies."""

    def __init__(self, maps: SceneTextures) -> None:
        empty = np.zeros((TABLE_ROWS, COLUMNS, 4), dtype=np.float32)
        self._table = _create_texture(empty, RGBA_FLOAT, "edge")
        self._textures = {
            "Table": self._table,
            "Sky": _create_texture(maps.sky, RGBA_FLOAT, "edge"),
            "Airlight": _create_texture(maps.airlight, RGBA_FLOAT, "edge"),
            "Wear": _create_texture(maps.wear, R_UNORM8, "edge"),
            "Puddles": _create_texture(maps.puddles, R_FLOAT, "repeat"),
            "Shelter": _create_texture(maps.shelter, RG_FLOAT, "edge"),
        }

    def attach_to_camera(self, camera: sapien.render.RenderCameraComponent) -> None:
        """Let a new camera see table and maps."""
        for name, texture in self._textures.items():
            camera.set_texture(name, texture)

    def set_body_state(
        self, body: sapien.render.RenderBodyComponent, lamp_bits: int, *, hidden: bool
    ) -> None:
        """Say which lenses of a body shine (bits in `lenses.glsl`), and whether it is hidden."""
        body.set_property("lit", lamp_bits)
        body.set_property("hidden", int(hidden))

    def upload_table(self, table: NDArray[np.float32]) -> None:
        """Replace the table, for the pictures to come."""
        self._table.upload(table)


class RayTracedBindings:
    """All travels in the material of the scene's first object, with the states below the table.

    SAPIEN's ray-tracing packs see no textures of cameras and no properties of bodies.
    """

    def __init__(self, scene: sapien.Scene, maps: SceneTextures) -> None:
        self._rows = np.zeros((TABLE_ROWS + BODY_STATE_ROWS, COLUMNS, 4), dtype=np.float32)
        self._body_states = self._rows[TABLE_ROWS:].reshape(-1, 4)
        self._table = _create_material_texture(self._rows, RGBA_FLOAT, "edge")
        material = sapien.render.RenderMaterial()
        material.base_color_texture = self._table
        material.emission_texture = _create_material_texture(maps.sky, RGBA_FLOAT, "edge")
        material.transmission_texture = _create_material_texture(maps.airlight, RGBA_FLOAT, "edge")
        material.roughness_texture = _create_material_texture(maps.wear, R_UNORM8, "edge")
        material.metallic_texture = _create_material_texture(maps.puddles, R_FLOAT, "repeat")
        material.normal_texture = _create_material_texture(maps.shelter, RG_FLOAT, "edge")
        carrier = sapien.render.RenderBodyComponent()
        carrier.attach(sapien.render.RenderShapeBox([0.01, 0.01, 0.01], material))
        entity = sapien.Entity()
        entity.add_component(carrier)
        entity.set_pose(sapien.Pose([0.0, 0.0, -2e4]))
        scene.add_entity(entity)

    def attach_to_camera(self, camera: sapien.render.RenderCameraComponent) -> None:
        """Every camera sees the scene's materials."""

    def set_body_state(
        self, body: sapien.render.RenderBodyComponent, lamp_bits: int, *, hidden: bool
    ) -> None:
        """Say which lenses of a body shine (bits in `lenses.glsl`), and whether it is hidden."""
        number = body.entity.per_scene_id
        if number >= len(self._body_states):
            raise BackendError(
                f"a scene of more than {len(self._body_states)} bodies; a ray-traced one holds no"
                " more, a raster one does"
            )
        self._body_states[number, :2] = lamp_bits, hidden

    def upload_table(self, table: NDArray[np.float32]) -> None:
        """Replace the table, for the pictures to come."""
        self._rows[:TABLE_ROWS] = table
        self._table.upload(self._rows)


def _create_texture(
    texels: NDArray[Any], texel: str, beyond: Literal["edge", "repeat"]
) -> sapien.render.RenderTexture:
    return sapien.render.RenderTexture(texels, 2, texel, address_mode=beyond)


def _create_material_texture(
    texels: NDArray[Any], texel: str, beyond: Literal["edge", "repeat"]
) -> sapien.render.RenderTexture2D:
    return sapien.render.RenderTexture2D(texels, texel, address_mode=beyond)

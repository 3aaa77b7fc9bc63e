"""Hands the shaders data beyond the scene: table, textures, and the state of bodies."""

import numpy as np
import sapien

from advercity.errors import BackendError
from advercity.geometry.arrays import Float32Array
from advercity_sapien.shader_constants import SKY_M
from advercity_sapien.shader_table import (
    BODY_STATE_ROWS,
    CARRIED_TEXTURES,
    COLUMNS,
    SCENE_TEXTURES,
    TABLE_ROWS,
    SceneTexels,
    ShaderTable,
)

RenderBody = sapien.render.RenderBodyComponent
TABLE = SCENE_TEXTURES[0]


class RasterBindings:
    """Table and textures belong to each camera, states are properties of the bodies."""

    def __init__(self, maps: SceneTexels) -> None:
        texels = {TABLE.name: ShaderTable().texels, **maps}
        self._textures = {
            item.name: sapien.render.RenderTexture(
                texels[item.name], 2, item.texel, address_mode=item.wrap
            )
            for item in SCENE_TEXTURES
        }

    def attach_to_camera(self, camera: sapien.render.RenderCameraComponent) -> None:
        """Give a new camera the table and the textures."""
        for name, texture in self._textures.items():
            camera.set_texture(name, texture)

    def set_lit_lamps(self, body: RenderBody, lamp_bits: int) -> None:
        """Set which lamps of a body are lit (`LIT_...` in GLSL)."""
        body.set_property("lit", lamp_bits)

    def set_hidden(self, body: RenderBody, *, hidden: bool) -> None:
        """Set whether cameras see no more of a body than its shadow."""
        body.set_property("hidden", int(hidden))

    def set_static_mesh(self, body: RenderBody, number: int) -> None:
        """Set the static mesh of a tile, 0 for other bodies: tiles meet without an edge."""
        body.set_property("staticMesh", number)

    def upload_table(self, table: ShaderTable) -> None:
        """Copy the table to the device, for the images to come."""
        self._textures[TABLE.name].upload(table.texels)

    def upload_maps(self, maps: SceneTexels) -> None:
        """Copy textures of the same sizes as before to the device."""
        for name, texels in maps.items():
            self._textures[name].upload(texels if texels.ndim == 3 else texels[..., None])


class RayTracedBindings:
    """All travels in the material of the scene's first object, the states below the table.

    SAPIEN's ray-tracing packs see no textures of cameras and no properties of bodies. The shaders
    look for geometry instance 0, so this must be made before any other body of the scene.

    This object is a box around all others: rays without another hit meet it, and show the sky.
    Shaders for misses would see no textures.
    """

    def __init__(self, scene: sapien.Scene, maps: SceneTexels) -> None:
        self._rows = np.zeros((TABLE_ROWS + BODY_STATE_ROWS, COLUMNS, 4), dtype=np.float32)
        self._body_states = self._rows[TABLE_ROWS:].reshape(-1, 4)
        texels = {TABLE.name: self._rows, **maps}
        material = sapien.render.RenderMaterial()
        self._textures = {
            item.name: sapien.render.RenderTexture2D(
                texels[item.name], item.texel, address_mode=item.wrap
            )
            for item in CARRIED_TEXTURES
        }
        for item in CARRIED_TEXTURES:
            slot = "base_color" if item.material_slot == "diffuse" else item.material_slot
            setattr(material, f"{slot}_texture", self._textures[item.name])
        carrier = sapien.render.RenderBodyComponent()
        carrier.attach(sapien.render.RenderShapeBox([SKY_M] * 3, material))
        entity = sapien.Entity()
        entity.add_component(carrier)
        scene.add_entity(entity)

    def attach_to_camera(self, camera: sapien.render.RenderCameraComponent) -> None:
        """Do nothing: every camera sees the scene's materials."""

    def set_lit_lamps(self, body: RenderBody, lamp_bits: int) -> None:
        """Set which lamps of a body are lit (`LIT_...` in GLSL)."""
        self._body_state(body)[0] = lamp_bits

    def set_hidden(self, body: RenderBody, *, hidden: bool) -> None:
        """Set whether cameras see no more of a body than its shadow."""
        self._body_state(body)[1] = hidden

    def set_static_mesh(self, body: RenderBody, number: int) -> None:
        """Do nothing: rays know no edges."""

    def _body_state(self, body: RenderBody) -> Float32Array:
        """Return the texel (4,) of a body, as a view."""
        number = body.entity.per_scene_id
        if number >= len(self._body_states):
            raise BackendError(
                f"the scene has more than {len(self._body_states)} bodies, the limit of the"
                " ray-traced renderer; use a raster profile"
            )
        return self._body_states[number]

    def upload_table(self, table: ShaderTable) -> None:
        """Copy the table and the states to the device, for the images to come."""
        self._rows[:TABLE_ROWS] = table.texels
        self._textures[TABLE.name].upload(self._rows)

    def upload_maps(self, maps: SceneTexels) -> None:
        """Copy textures of the same sizes to the device, except the raster pack's own."""
        for name in self._textures.keys() & maps.keys():
            self._textures[name].upload(maps[name])


ShaderBindings = RasterBindings | RayTracedBindings
"""How one of the two shader packs gets table, textures and the states of bodies."""

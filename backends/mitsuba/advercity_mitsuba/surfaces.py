"""Optical properties of meshes' surfaces, as a table of rows for the kernels."""

from collections.abc import Mapping
from dataclasses import dataclass
from enum import IntFlag

import numpy as np

from advercity.geometry.arrays import Float32Array
from advercity.geometry.mesh import Mesh
from advercity.material_maps import MaterialMaps
from advercity.materials import ACTOR_PAINT, MATERIALS
from advercity.rendering.lamp_lenses import LENS_KINDS, is_snowless
from advercity.rendering.panes import is_seen_through
from advercity.rendering.raycaster import MATERIAL_INDEX, MATERIAL_NAMES

COLUMNS = 12
"""Numbers of a row: albedo (3), roughness; metallic, texture, lens, flags; images, their width,
positive along the world's axes and negative along the mesh's, and two free ones."""


class SurfaceFlag(IntFlag):
    """Further properties of a surface."""

    SNOWLESS = 1
    PANE = 2
    """Transparent glass."""
    PAINTED = 4
    """All but the images is of the actor's paint."""


@dataclass(frozen=True)
class _Surface:
    material: str
    maps: str
    flags: SurfaceFlag
    axes: int


class SurfaceTable:
    """Rows of all materials of the core's table in its order, and of their variants in meshes.

    Attributes:
        map_names: Names of the surfaces' images, by number.
    """

    def __init__(self, maps: Mapping[str, MaterialMaps]) -> None:
        self._maps = maps
        self._rows: dict[_Surface, int] = {}
        self._values: list[list[float]] = []
        self.map_names: list[str] = []
        for name in MATERIAL_NAMES:
            self._add(_Surface(name, "", _find_flags(name), 0))

    @property
    def values(self) -> Float32Array:
        """The table (rows, COLUMNS)."""
        return np.array(self._values, np.float32)

    def get_row(self, mesh: Mesh, *, is_static: bool) -> int:
        """Get the row of a mesh's surface; it is made when it is first needed."""
        is_painted = mesh.material == ACTOR_PAINT
        material = MATERIAL_NAMES[0] if is_painted else mesh.material
        flags = SurfaceFlag.PAINTED if is_painted else _find_flags(material)
        axes = -1 if mesh.uv is not None else int(is_static)
        if is_seen_through(mesh, is_static=is_static):
            flags |= SurfaceFlag.PANE
        own = mesh.maps or ("" if is_painted else MATERIALS[material].maps)
        maps = own if axes and own in self._maps else ""
        surface = _Surface(material, maps, flags, axes if maps else 0)
        return self._rows[surface] if surface in self._rows else self._add(surface)

    def _add(self, surface: _Surface) -> int:
        if surface.maps and surface.maps not in self.map_names:
            self.map_names.append(surface.maps)
        known = MATERIALS[surface.material]
        number = self.map_names.index(surface.maps) if surface.maps else -1
        width_m = surface.axes * self._maps[surface.maps].tile_m if surface.maps else 0.0
        lens = LENS_KINDS.get(surface.material, 0)
        properties = [known.roughness, known.metallic, known.texture, lens, surface.flags]
        self._values.append([*known.albedo, *map(float, properties), number, width_m, 0.0, 0.0])
        self._rows[surface] = len(self._values) - 1
        return self._rows[surface]


def get_paint_row(paint: str) -> int:
    """Get the row of an actor's paint."""
    return MATERIAL_INDEX.get(paint, 0)


def _find_flags(material: str) -> SurfaceFlag:
    return SurfaceFlag.SNOWLESS if is_snowless(material) else SurfaceFlag(0)

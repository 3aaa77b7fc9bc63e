"""The shaders' numbers and textures: one description for Python and for GLSL.

Numbers travel in a texture of rows of COLUMNS texels. The first row has the parameters of air and
light, the sections below it have lists of lamps and, in ray-traced scenes, the states of bodies.
`shader_constants` writes this description as GLSL: no row, column or size is typed twice.
The renderer works in kcd/m² and klx, so no value is far from 1.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import accumulate
from math import ceil, prod
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from advercity.geometry.arrays import Float32Array
from advercity.rendering.fog_beams import FOG_BEAM_NODES

KILO = 1e-3
"""Factor from cd/m² and lx to the renderer's kcd/m² and klx."""
COLUMNS = 512
GRID_CELLS, CELL_LAMPS = 48, 65_536
"""Cells along each edge of the ground with lamps; room for lamps in the lists of all cells."""
TILES_HIGH, TILES_WIDE, LAMPS_PER_TILE = 18, 32, 24
"""Tiles of an image."""
BEARINGS, LAMPS_PER_BEARING = 64, 32
"""Sectors of the horizon, counterclockwise from -180 degrees."""
FOG_BEAM_TABLES = 4
"""Tables of low beams and front fog lamps, two each."""
FOG_BEAM_SCALE = 2.0**20
"""Factor on the values of these tables, which halves of a float hold: 0.06 to 1e-13 1/m²."""


@dataclass(frozen=True)
class Parameter:
    """A number or vector of the table's first row.

    Attributes:
        name: Keyword of `ShaderTable.set_parameters`.
        glsl: GLSL function returning it; takes an index if `count` is more than 1.
        column: First texel.
        components: Components of the texel, such as `x` or `rgb`.
        count: Number of texels.
    """

    name: str
    glsl: str
    column: int
    components: str
    count: int = 1

    @property
    def slices(self) -> tuple[slice, slice]:
        """Texels and components in a row (COLUMNS, 4)."""
        first = "xyzw".index(self.components[0].replace("r", "x"))
        columns = slice(self.column, self.column + self.count)
        return columns, slice(first, first + len(self.components))


@dataclass(frozen=True)
class Section:
    """Whole rows of the table.

    Attributes:
        name: Its GLSL constant is `<NAME>_ROW`.
        texels: Least number of texels; rows are filled up.
    """

    name: str
    texels: int


@dataclass(frozen=True)
class SceneTexture:
    """A texture readable in every shader pass as `sampler<name>`.

    Attributes:
        name: Name in GLSL; SAPIEN finds the textures of cameras by it.
        texel: SAPIEN's name of the texel format.
        wrap: Address mode.
        material_slot: Slot of the carrier's material in ray-traced scenes, as GLSL calls it;
            None for textures of the raster pack alone.
    """

    name: str
    texel: str
    wrap: Literal["edge", "repeat"]
    material_slot: str | None


# Columns are explicit, so a change of this list shows every move.
PARAMETERS = (
    Parameter("extinction", "extinction", 0, "x"),
    Parameter("wetness", "wetness", 0, "y"),
    Parameter("puddle_level", "puddleLevel", 0, "z"),
    Parameter("ripple_slope", "rippleSlope", 0, "w"),
    Parameter("horizon_airlight", "horizonAirlight", 1, "rgb"),
    Parameter("night", "nightFlag", 1, "w"),
    Parameter("probe_map_extent", "probeMapExtent", 2, "xyzw"),
    Parameter("sun_irradiance", "sunIrradiance", 3, "rgb"),
    Parameter("sun_direction", "sunDirection", 4, "xyz"),
    Parameter("sky_harmonics", "skyHarmonic", 5, "rgb", count=9),
    Parameter("wear_map_extent", "wearMapExtent", 14, "xyzw"),
    Parameter("lamp_grid", "lampGrid", 15, "xyzw"),
    Parameter("snow_depth", "snowDepth", 16, "x"),
    Parameter("snow_between_ruts", "snowBetweenRuts", 16, "y"),
    Parameter("snow_in_ruts", "snowInRuts", 16, "z"),
    Parameter("frame_index", "frameIndex", 16, "w"),
    Parameter("shelter_map_extent", "shelterMapExtent", 17, "xyzw"),
    Parameter("ice_cover", "iceCover", 18, "w"),
    Parameter("probe_open_shape", "probeOpenShape", 19, "xyzw", count=2),
)
SECTIONS = (
    Section("parameters", COLUMNS),
    Section("lamps", 4 * COLUMNS),
    Section("cells", GRID_CELLS**2),
    Section("cell_lamps", CELL_LAMPS // 4),
    Section("tiles", TILES_HIGH * TILES_WIDE * LAMPS_PER_TILE // 4),
    Section("bearings", BEARINGS * LAMPS_PER_BEARING // 4),
    Section("fog_beams", FOG_BEAM_TABLES * prod(FOG_BEAM_NODES)),
    Section("bodies", 32 * COLUMNS),
)
SCENE_TEXTURES = (
    # SAPIEN's material calls the slot of GLSL's `diffuse` texture `base_color`.
    SceneTexture("Table", "R32G32B32A32Sfloat", "edge", "diffuse"),
    SceneTexture("Sky", "R32G32B32A32Sfloat", "edge", "emission"),
    SceneTexture("Airlight", "R32G32B32A32Sfloat", "edge", "transmission"),
    SceneTexture("Wear", "R8G8Unorm", "edge", "roughness"),
    SceneTexture("Puddles", "R32Sfloat", "repeat", "metallic"),
    SceneTexture("Shelter", "R32G32B32A32Sfloat", "edge", "normal"),
    SceneTexture("ProbeLight", "R32G32B32A32Sfloat", "edge", None),
    SceneTexture("ProbeFirst", "R32G32B32A32Sfloat", "edge", None),
    SceneTexture("ProbeSecond", "R32G32B32A32Sfloat", "edge", None),
    SceneTexture("SkylineLight", "R16G16B16A16Sfloat", "edge", None),
    SceneTexture("SkylineNearness", "R8Unorm", "edge", None),
    SceneTexture("Contact", "R8Unorm", "edge", None),
    SceneTexture("LampReach", "R32Sfloat", "edge", None),
)
CARRIED_TEXTURES = tuple(item for item in SCENE_TEXTURES if item.material_slot)
"""Textures of both packs."""

_HEIGHTS = {section.name: ceil(section.texels / COLUMNS) for section in SECTIONS}
FIRST_ROWS = dict(zip(_HEIGHTS, accumulate([0, *_HEIGHTS.values()]), strict=False))
"""First row of each section."""
TABLE_ROWS = FIRST_ROWS["bodies"]
"""Rows of both renderers; the states of bodies follow in ray-traced scenes."""
BODY_STATE_ROWS = _HEIGHTS["bodies"]

SceneTexels = dict[str, NDArray[Any]]
"""Texels (h, w) or (h, w, channels) by name of texture, for all but the table."""


class ShaderTable:
    """The table's texels, and named access to them.

    Attributes:
        texels: (TABLE_ROWS, COLUMNS, 4).
    """

    def __init__(self) -> None:
        self.texels: Float32Array = np.zeros((TABLE_ROWS, COLUMNS, 4), dtype=np.float32)

    def set_parameters(self, **values: ArrayLike) -> None:
        """Write values of PARAMETERS by name, in kcd/m², klx and metres."""
        for name, value in values.items():
            parameter = _PARAMETERS_BY_NAME[name]
            self.texels[0][parameter.slices] = np.reshape(value, (parameter.count, -1))

    def set_fog_beams(self, tables: Float32Array) -> None:
        """Write tables (..., nodes up, 4) of scattered light.

        A texel has its node in its first two numbers, by two halves each, and the next one above in
        the others: shaders fetch both at once.
        """
        nodes = (tables * FOG_BEAM_SCALE).astype(np.float16)
        above = np.roll(nodes, -1, axis=-2)  # above the last, none is looked up
        section = self.section("fog_beams")
        section[:] = np.concatenate([nodes, above], axis=-1).view(np.float32).reshape(section.shape)

    def section(self, name: str) -> Float32Array:
        """Rows (height, COLUMNS, 4) of a section, as a view."""
        return self.texels[FIRST_ROWS[name] : FIRST_ROWS[name] + _HEIGHTS[name]]


_PARAMETERS_BY_NAME = {parameter.name: parameter for parameter in PARAMETERS}


def format_table_glsl() -> Iterator[str]:
    """Lines of GLSL reading the table: rows, sizes and one function for each parameter."""
    sizes = {
        "COLUMNS": COLUMNS,
        **{f"{name.upper()}_ROW": row for name, row in FIRST_ROWS.items()},
        "GRID_CELLS": GRID_CELLS,
        "TILES_HIGH": TILES_HIGH,
        "TILES_WIDE": TILES_WIDE,
        "BEARINGS": BEARINGS,
        # A texel holds four lamps.
        "TEXELS_PER_TILE": LAMPS_PER_TILE // 4,
        "TEXELS_PER_BEARING": LAMPS_PER_BEARING // 4,
        "FOG_BEAM_ROWS": prod(FOG_BEAM_NODES) // COLUMNS,
    }
    yield from (f"const int {name} = {value};" for name, value in sizes.items())
    nodes = ", ".join(map(str, FOG_BEAM_NODES))
    yield f"const ivec3 FOG_BEAM_NODES = ivec3({nodes});"
    yield ""
    for parameter in PARAMETERS:
        kind = {1: "float", 3: "vec3", 4: "vec4"}[len(parameter.components)]
        index, column = ("int i", " + i") if parameter.count > 1 else ("", "")
        yield (
            f"{kind} {parameter.glsl}({index}) {{ return texelFetch(samplerTable,"
            f" ivec2({parameter.column}{column}, 0), 0).{parameter.components}; }}"
        )


def format_scene_textures_glsl() -> Iterator[str]:
    """Lines of GLSL binding the textures in the material of the scene's first object."""
    for texture in CARRIED_TEXTURES:
        yield f"int {_index_name(texture)};"
        yield f"#define sampler{texture.name} textures[nonuniformEXT({_index_name(texture)})]"
    yield "\nvoid bindSceneTextures() {"
    yield "  TextureIndex carried = textureIndices.t[geometryInstances.i[0].materialIndex];"
    for texture in CARRIED_TEXTURES:
        yield f"  {_index_name(texture)} = carried.{texture.material_slot};"
    yield "}"


def _index_name(texture: SceneTexture) -> str:
    return f"{texture.name.lower()}Index"

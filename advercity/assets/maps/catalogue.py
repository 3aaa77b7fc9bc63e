"""The baked surfaces: the painter, the size of the tile and the material of each."""

from collections.abc import Callable
from dataclasses import dataclass

from advercity.assets.maps import ground, metal, roofs, timber, walls
from advercity.assets.maps.surface import Surface, encode_surface
from advercity.assets.maps.tile import Tile
from advercity.material_maps import MaterialMaps
from advercity.materials import MATERIALS


@dataclass(frozen=True)
class BakedSurface:
    """A baked surface.

    Attributes:
        paint: Paints a tile of it.
        tile_m: Length of the tile's sides.
        material: Material whose albedo and roughness the images have on average.
    """

    paint: Callable[[Tile], Surface]
    tile_m: float
    material: str


BAKED_SURFACES: dict[str, BakedSurface] = {
    "asphalt": BakedSurface(ground.paint_worn_asphalt, 1.0, "asphalt"),
    "asphalt_new": BakedSurface(ground.paint_new_asphalt, 1.0, "asphalt"),
    "paving": BakedSurface(ground.paint_paving, 2.0, "pavement"),
    "kerb": BakedSurface(ground.paint_kerb, 1.0, "kerb"),
    "gravel": BakedSurface(ground.paint_gravel, 1.5, "gravel"),
    "soil": BakedSurface(ground.paint_soil, 2.0, "soil"),
    "grass": BakedSurface(ground.paint_grass, 2.0, "grass"),
    "crops": BakedSurface(ground.paint_crops, 2.0, "crops"),
    "concrete": BakedSurface(walls.paint_concrete, 2.0, "concrete"),
    "concrete_panels": BakedSurface(walls.paint_concrete_panels, 4.0, "concrete"),
    "brick": BakedSurface(walls.paint_red_brick, 2.0, "brick"),
    "brick_yellow": BakedSurface(walls.paint_yellow_brick, 2.0, "brick_yellow"),
    "plaster": BakedSurface(walls.paint_plaster, 3.0, "plaster"),
    "roof_tile": BakedSurface(roofs.paint_clay_tiles, 2.0, "roof_tile"),
    "roof_slate": BakedSurface(roofs.paint_slates, 2.0, "roof_slate"),
    "wood": BakedSurface(timber.paint_planks, 2.0, "wood"),
    "bark": BakedSurface(timber.paint_bark, 1.0, "bark"),
    "metal": BakedSurface(metal.paint_zinc, 1.0, "metal"),
    "metal_sheet": BakedSurface(metal.paint_corrugated_sheet, 2.0, "metal"),
}


def bake_maps(name: str, pixels: int = 1024) -> MaterialMaps:
    """Bake the images of a named surface; takes some tenths of a second."""
    declared = BAKED_SURFACES[name]
    tile = Tile(name, declared.tile_m, pixels)
    return encode_surface(declared.paint(tile), tile, MATERIALS[declared.material])

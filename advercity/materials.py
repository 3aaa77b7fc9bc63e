"""Materials of surfaces: the one home of optical properties, for all sensors.

Cameras take the albedo (linear sRGB), LiDARs the reflectance at 905 nm, radars the permittivity and
the roughness at 77 GHz; all are of the same surface, so they are in one row. Optical values are
typical ones (Muckenhuber et al., Sensors 20, 3309, 2020, and common handbooks). Permittivities of
concrete, brick, plaster (as plasterboard), wood, glass and plastics (as acrylic) are from
Recommendation ITU-R P.2040-3, table 3, at 77 GHz, which is above the 40 GHz to which brick and
below the 110 GHz from which acrylic is listed; skin: Gabriel et al., Phys. Med. Biol. 41, 2271
(1996), dry; water at 10 deg C: Liebe et al., Int. J. Infrared Millim. Waves 12, 659 (1991).
Permittivities of asphalt (4.8 up to 40 GHz in the same table), soil, plants and rubber are
assumptions. So are roughnesses; slopes of bodies include details missing in meshes.

Slopes of facets at 905 nm are by Oren and Nayar (Generalization of Lambert's reflectance model,
SIGGRAPH 1994): 30 deg for wall plaster and 35 deg for sand, as commonly quoted. The slope of
asphalt is fitted to a scan of nuScenes (`docs/lidar_calibration.md`); the others are assumptions.

Emissivities from 8 to 14 um are from handbooks (Gaussorgues, Infrared Thermography, 1994; of chrome
and bare sheet between polished and oxidised); responses to the sun are assumptions: they give
asphalt 30 K over the air at a summer's noon, and walls and roofs commonly measured temperatures.
"""

from dataclasses import dataclass
from enum import IntEnum


class Texture(IntEnum):
    """How the albedo varies over a surface, around its mean; shaders know them by number."""

    PLAIN = 0
    ASPHALT = 1
    PAVING = 2
    GRASS = 3
    SOIL = 4
    CROPS = 5
    BRICK = 6
    PLASTER = 7
    BARK = 8
    LEAVES = 9
    TILES = 10
    WOOD = 11
    STONE = 12
    MARKING = 13
    SLABS = 14
    CROWN = 15
    ROOM = 16
    SHOP = 17
    """View into a room or a shop behind a pane; by night its lamp may light it."""


FACET_SLOPES_DEG = {
    Texture.ASPHALT: 22.0,
    Texture.MARKING: 22.0,
    Texture.PAVING: 20.0,
    Texture.SLABS: 20.0,
    Texture.STONE: 25.0,
    Texture.BRICK: 20.0,
    Texture.PLASTER: 30.0,
    Texture.TILES: 20.0,
    Texture.BARK: 30.0,
    Texture.SOIL: 35.0,
    Texture.GRASS: 35.0,
    Texture.CROPS: 35.0,
}
"""Standard deviation of the inclination of facets, by which rough surfaces return more light at
grazing incidence than Lambert's law says; surfaces of other textures are smooth."""


@dataclass(frozen=True)
class RadarSurface:
    """A surface at 77 GHz, rough at two scales.

    Attributes:
        permittivity: Relative; its imaginary part is the loss, positive.
        height_mm: Standard deviation of the height, which decides how much it mirrors.
        slope: Standard deviation of the slope, by which it scatters the rest around the mirror
            direction.
    """

    permittivity: complex
    height_mm: float
    slope: float


PLATE_77GHZ = RadarSurface(1.0 + 1e6j, 0.02, 0.05)
"""Flat metal, practically a perfect conductor."""
METAL_77GHZ = RadarSurface(1.0 + 1e6j, 0.3, 0.3)
"""Bent metal, or metal in several parts."""
CAR_BODY_77GHZ = RadarSurface(1.0 + 1e6j, 1.0, 0.3)
ASPHALT_77GHZ = RadarSurface(4.5 + 0.3j, 0.6, 0.4)
CONCRETE_77GHZ = RadarSurface(5.2 + 0.3j, 0.4, 0.3)
PLASTER_77GHZ = RadarSurface(2.7 + 0.1j, 0.4, 0.3)
BRICK_77GHZ = RadarSurface(3.9 + 0.01j, 0.8, 0.3)
GLASS_77GHZ = RadarSurface(6.3 + 0.3j, 0.02, 0.05)
WOOD_77GHZ = RadarSurface(2.0 + 0.1j, 0.8, 0.3)
SOIL_77GHZ = RadarSurface(4.0 + 1.0j, 3.0, 0.5)
PLANTS_77GHZ = RadarSurface(5.0 + 3.0j, 10.0, 0.8)
PLASTIC_77GHZ = RadarSurface(2.6 + 0.03j, 0.3, 0.3)
RUBBER_77GHZ = RadarSurface(3.5 + 0.5j, 1.0, 0.3)
SKIN_77GHZ = RadarSurface(6.6 + 8.9j, 1.0, 0.4)
CLOTH_77GHZ = RadarSurface(4.0 + 4.0j, 1.0, 0.4)
"""Skin through textile (2 dB): assumed to give a pedestrian the measured cross-section."""
WATER_77GHZ = RadarSurface(7.6 + 12.8j, 0.02, 0.05)


@dataclass(frozen=True)
class ThermalSurface:
    """A surface in the infrared, and its warming.

    Attributes:
        emissivity: From 8 to 14 um, facing it; the rest it reflects.
        sun_response: Its excess of temperature in the sun, as a fraction of an insulated sheet's:
            the rest goes inside or evaporates.
        stored: Fraction of the day's mean excess kept at any hour; the higher, the less it cools.
    """

    emissivity: float
    sun_response: float
    stored: float


ASPHALT_LWIR = ThermalSurface(0.95, 0.55, 0.4)
CONCRETE_LWIR = ThermalSurface(0.93, 0.6, 0.4)
WALL_LWIR = ThermalSurface(0.92, 0.5, 0.4)
GLASS_LWIR = ThermalSurface(0.85, 0.9, 0.0)
WOOD_LWIR = ThermalSurface(0.92, 0.7, 0.1)
SOIL_LWIR = ThermalSurface(0.94, 0.5, 0.3)
PLANTS_LWIR = ThermalSurface(0.97, 0.2, 0.0)
"""Leaves evaporate most of their heat from the sun."""
RUBBER_LWIR = ThermalSurface(0.94, 0.8, 0.1)
BARE_METAL_LWIR = ThermalSurface(0.30, 0.9, 0.0)
SHEET_LWIR = ThermalSurface(0.92, 0.9, 0.0)
"""Painted metal and plastics."""
SKIN_LWIR = ThermalSurface(0.98, 0.0, 0.0)
CLOTH_LWIR = ThermalSurface(0.93, 0.4, 0.0)
WATER_LWIR = ThermalSurface(0.985, 0.1, 0.3)


@dataclass(frozen=True)
class Material:
    """Optical properties of a surface, and those for radars and thermal cameras.

    Attributes:
        albedo: Linear sRGB; a texture varies it over the surface and keeps its mean.
        reflectance_905nm: Diffuse reflectance at the wavelength of LiDARs, at normal incidence.
        radar: The surface at 77 GHz.
        thermal: The surface in the infrared.
        roughness: Microfacet roughness of the specular lobe, 0 to 1.
        metallic: 0 for dielectrics, 1 for bare metal.
        texture: Pattern of the albedo.
        maps: Name of the images of its surface, or none.
        sheeting_reflectance: Equivalent reflectance of retroreflecting sheeting, pi times its
            coefficient R_A in cd/(lx m^2).
        bead_reflectance: The same of glass beads in lane paint, pi times R_L of EN 1436.
        is_varnished: Whether a clear coat adds a highlight at normal incidence.
        is_transparent: Whether laser beams get through it.
    """

    albedo: tuple[float, float, float]
    reflectance_905nm: float
    radar: RadarSurface
    thermal: ThermalSurface = SHEET_LWIR
    roughness: float = 0.9
    metallic: float = 0.0
    texture: Texture = Texture.PLAIN
    maps: str = ""
    sheeting_reflectance: float = 0.0
    bead_reflectance: float = 0.0
    is_varnished: bool = False
    is_transparent: bool = False

    @property
    def facet_slope_deg(self) -> float:
        """Standard deviation of the inclination of its facets at 905 nm; 0 is Lambert's law."""
        return FACET_SLOPES_DEG.get(self.texture, 0.0)


# Snow is no row of the table, since it lies on other surfaces. Its three values are three facts:
# a landscape has shadows and bare spots, a flake on a lens has none, and snow absorbs infrared.
SNOWY_LANDSCAPE_ALBEDO = 0.85
"""Visible albedo of a landscape under fresh snow."""
SNOWFLAKE_ALBEDO = 0.9
"""Visible albedo of a flake seen from nearby, as on a lens."""
SNOW_REFLECTANCE_905NM = 0.8
SNOW_FACET_SLOPE_DEG = 20.0
"""Slope of lying snow; an assumption."""

TRANSMITTED_BY_LEAVES = 0.4
"""Diffuse light through leaves, relative to the light they reflect."""

ACTOR_PAINT = "paint"
"""Placeholder for the material of parts in their actor's paint."""


def _car_paint(
    albedo: tuple[float, float, float],
    reflectance_905nm: float,
    roughness: float = 0.25,
    metallic: float = 0.0,
) -> Material:
    return Material(
        albedo,
        reflectance_905nm,
        CAR_BODY_77GHZ,
        SHEET_LWIR,
        roughness,
        metallic,
        is_varnished=True,
    )


def _pane(albedo: tuple[float, float, float], texture: Texture = Texture.PLAIN) -> Material:
    return Material(
        albedo,
        0.02,
        GLASS_77GHZ,
        GLASS_LWIR,
        roughness=0.05,
        texture=texture,
        is_transparent=True,
    )


MATERIALS: dict[str, Material] = {
    "asphalt": Material(
        (0.10, 0.10, 0.105),
        0.20,
        ASPHALT_77GHZ,
        ASPHALT_LWIR,
        roughness=0.85,
        texture=Texture.ASPHALT,
        maps="asphalt",
    ),
    # Patches of asphalt: one laid lately, whose binder is still dark, and one bleached by the sun.
    "asphalt_new": Material(
        (0.068, 0.068, 0.072),
        0.14,
        ASPHALT_77GHZ,
        ASPHALT_LWIR,
        roughness=0.85,
        texture=Texture.ASPHALT,
        maps="asphalt_new",
    ),
    "asphalt_aged": Material(
        (0.125, 0.124, 0.124),
        0.23,
        ASPHALT_77GHZ,
        ASPHALT_LWIR,
        roughness=0.85,
        texture=Texture.ASPHALT,
        maps="asphalt",
    ),
    # Seal of cracks and joints.
    "bitumen": Material(
        (0.05, 0.05, 0.053),
        0.06,
        ASPHALT_77GHZ,
        ASPHALT_LWIR,
        roughness=0.7,
        texture=Texture.ASPHALT,
    ),
    # Rusted, and polished by tyres.
    "cast_iron": Material(
        (0.078, 0.072, 0.067),
        0.16,
        METAL_77GHZ,
        WALL_LWIR,
        roughness=0.65,
        texture=Texture.ASPHALT,
    ),
    "paint_white": Material(
        (0.70, 0.70, 0.68),
        0.70,
        ASPHALT_77GHZ,
        ASPHALT_LWIR,
        roughness=0.6,
        texture=Texture.MARKING,
        bead_reflectance=0.5,
    ),
    "paint_yellow": Material(
        (0.70, 0.48, 0.06),
        0.60,
        ASPHALT_77GHZ,
        ASPHALT_LWIR,
        roughness=0.6,
        texture=Texture.MARKING,
        bead_reflectance=0.5,
    ),
    "concrete": Material(
        (0.36, 0.35, 0.33),
        0.35,
        CONCRETE_77GHZ,
        CONCRETE_LWIR,
        texture=Texture.PAVING,
        maps="concrete",
    ),
    "pavement": Material(
        (0.36, 0.355, 0.34),
        0.35,
        CONCRETE_77GHZ,
        CONCRETE_LWIR,
        texture=Texture.SLABS,
        maps="paving",
    ),
    "kerb": Material(
        (0.33, 0.325, 0.31), 0.35, CONCRETE_77GHZ, CONCRETE_LWIR, texture=Texture.STONE, maps="kerb"
    ),
    "gravel": Material(
        (0.28, 0.26, 0.23), 0.30, SOIL_77GHZ, SOIL_LWIR, texture=Texture.STONE, maps="gravel"
    ),
    "grass": Material(
        (0.095, 0.135, 0.045), 0.40, PLANTS_77GHZ, PLANTS_LWIR, texture=Texture.GRASS, maps="grass"
    ),
    "soil": Material(
        (0.17, 0.11, 0.07), 0.25, SOIL_77GHZ, SOIL_LWIR, texture=Texture.SOIL, maps="soil"
    ),
    "crops": Material(
        (0.25, 0.27, 0.07), 0.45, PLANTS_77GHZ, PLANTS_LWIR, texture=Texture.CROPS, maps="crops"
    ),
    "leaves": Material((0.06, 0.13, 0.03), 0.45, PLANTS_77GHZ, PLANTS_LWIR, texture=Texture.LEAVES),
    "needles": Material(
        (0.035, 0.075, 0.03), 0.40, PLANTS_77GHZ, PLANTS_LWIR, texture=Texture.LEAVES
    ),
    "bark": Material(
        (0.12, 0.085, 0.06), 0.30, WOOD_77GHZ, WOOD_LWIR, texture=Texture.BARK, maps="bark"
    ),
    "brick": Material(
        (0.33, 0.14, 0.10), 0.35, BRICK_77GHZ, WALL_LWIR, texture=Texture.BRICK, maps="brick"
    ),
    "plaster": Material(
        (0.58, 0.54, 0.46), 0.60, PLASTER_77GHZ, WALL_LWIR, texture=Texture.PLASTER, maps="plaster"
    ),
    "plaster_ochre": Material(
        (0.54, 0.38, 0.20), 0.55, PLASTER_77GHZ, WALL_LWIR, texture=Texture.PLASTER, maps="plaster"
    ),
    "plaster_white": Material(
        (0.68, 0.67, 0.64), 0.65, PLASTER_77GHZ, WALL_LWIR, texture=Texture.PLASTER, maps="plaster"
    ),
    "roof_tile": Material(
        (0.24, 0.09, 0.06),
        0.35,
        CONCRETE_77GHZ,
        CONCRETE_LWIR,
        texture=Texture.TILES,
        maps="roof_tile",
    ),
    "wood": Material(
        (0.30, 0.20, 0.12), 0.50, WOOD_77GHZ, WOOD_LWIR, texture=Texture.WOOD, maps="wood"
    ),
    # For window frames, among others.
    "enamel_white": Material((0.70, 0.70, 0.68), 0.70, PLASTIC_77GHZ, SHEET_LWIR, roughness=0.6),
    "metal": Material(
        (0.45, 0.45, 0.46), 0.30, METAL_77GHZ, BARE_METAL_LWIR, roughness=0.4, metallic=0.9
    ),
    "glass": _pane((0.03, 0.035, 0.04)),
    # Panes before rooms, dark or lit by night; lit ones have the colours of lamps of 2700 and 4000
    # K, on walls that are not quite white.
    "room_dark": _pane((0.03, 0.03, 0.03), Texture.ROOM),
    "shop_dark": _pane((0.06, 0.06, 0.06), Texture.SHOP),
    "room_warm": _pane((0.060, 0.028, 0.0076), Texture.ROOM),
    "room_cool": _pane((0.048, 0.032, 0.018), Texture.ROOM),
    "room_shop": _pane((0.048, 0.032, 0.018), Texture.SHOP),
    "rubber": Material((0.025, 0.025, 0.025), 0.04, RUBBER_77GHZ, RUBBER_LWIR),
    "black_plastic": Material((0.04, 0.04, 0.04), 0.06, PLASTIC_77GHZ, SHEET_LWIR, roughness=0.5),
    "plastic_orange": Material((0.70, 0.15, 0.02), 0.60, PLASTIC_77GHZ, SHEET_LWIR, roughness=0.6),
    "car_paint_white": _car_paint((0.78, 0.78, 0.77), 0.75),
    "car_paint_silver": _car_paint((0.48, 0.49, 0.50), 0.50, metallic=0.3),
    "car_paint_grey": _car_paint((0.12, 0.125, 0.13), 0.30, metallic=0.2),
    "car_paint_black": _car_paint((0.02, 0.02, 0.022), 0.06, roughness=0.2),
    "car_paint_red": _car_paint((0.42, 0.03, 0.025), 0.45),
    "car_paint_blue": _car_paint((0.022, 0.060, 0.24), 0.25),
    "car_paint_green": _car_paint((0.04, 0.15, 0.06), 0.30),
    "car_paint_brown": _car_paint((0.16, 0.10, 0.06), 0.35),
    "car_paint_yellow": _car_paint((0.70, 0.45, 0.02), 0.60),
    "car_paint_orange": _car_paint((0.60, 0.17, 0.02), 0.55),
    "car_paint_pearl": _car_paint((0.60, 0.58, 0.54), 0.70, metallic=0.1),
    "car_paint_graphite": _car_paint((0.050, 0.053, 0.058), 0.18, metallic=0.3),
    "car_paint_navy": _car_paint((0.010, 0.018, 0.050), 0.12, metallic=0.2),
    "car_paint_wine": _car_paint((0.13, 0.012, 0.018), 0.40, metallic=0.1),
    "car_paint_beige": _car_paint((0.34, 0.29, 0.22), 0.50, metallic=0.2),
    "chrome": Material(
        (0.62, 0.62, 0.63), 0.30, CAR_BODY_77GHZ, BARE_METAL_LWIR, roughness=0.12, metallic=1.0
    ),
    "upholstery": Material((0.06, 0.06, 0.065), 0.35, PLASTIC_77GHZ, SHEET_LWIR),
    "licence_plate": Material(
        (0.65, 0.65, 0.62),
        0.90,
        PLATE_77GHZ,
        SHEET_LWIR,
        roughness=0.5,
        sheeting_reflectance=190.0,
    ),
    "lamp_white": Material((0.9, 0.9, 0.85), 0.50, PLASTIC_77GHZ, SHEET_LWIR, roughness=0.2),
    "lamp_red": Material(
        (0.45, 0.02, 0.02),
        0.50,
        PLASTIC_77GHZ,
        SHEET_LWIR,
        roughness=0.2,
        sheeting_reflectance=20.0,
    ),
    "lamp_amber": Material((0.60, 0.22, 0.02), 0.50, PLASTIC_77GHZ, SHEET_LWIR, roughness=0.2),
    "lamp_amber_left": Material((0.60, 0.22, 0.02), 0.50, PLASTIC_77GHZ, SHEET_LWIR, roughness=0.2),
    "lamp_amber_right": Material(
        (0.60, 0.22, 0.02), 0.50, PLASTIC_77GHZ, SHEET_LWIR, roughness=0.2
    ),
    "skin": Material((0.45, 0.29, 0.21), 0.55, SKIN_77GHZ, SKIN_LWIR),
    "skin_brown": Material((0.27, 0.155, 0.095), 0.52, SKIN_77GHZ, SKIN_LWIR),
    "skin_dark": Material((0.10, 0.058, 0.038), 0.45, SKIN_77GHZ, SKIN_LWIR),
    "hair_black": Material((0.018, 0.016, 0.015), 0.25, SKIN_77GHZ, SKIN_LWIR),
    "hair_brown": Material((0.07, 0.042, 0.025), 0.35, SKIN_77GHZ, SKIN_LWIR),
    "hair_blond": Material((0.36, 0.25, 0.11), 0.55, SKIN_77GHZ, SKIN_LWIR),
    "hair_grey": Material((0.33, 0.32, 0.31), 0.50, SKIN_77GHZ, SKIN_LWIR),
    "hair_red": Material((0.22, 0.075, 0.025), 0.45, SKIN_77GHZ, SKIN_LWIR),
    "leather": Material((0.035, 0.025, 0.02), 0.30, CLOTH_77GHZ, CLOTH_LWIR, roughness=0.6),
    "cloth_light": Material((0.55, 0.53, 0.48), 0.75, CLOTH_77GHZ, CLOTH_LWIR),
    "cloth_white": Material((0.74, 0.74, 0.73), 0.80, CLOTH_77GHZ, CLOTH_LWIR),
    "cloth_grey": Material((0.20, 0.20, 0.21), 0.50, CLOTH_77GHZ, CLOTH_LWIR),
    "cloth_dark": Material((0.06, 0.065, 0.08), 0.45, CLOTH_77GHZ, CLOTH_LWIR),
    "cloth_black": Material((0.018, 0.018, 0.02), 0.08, CLOTH_77GHZ, CLOTH_LWIR),
    "cloth_blue": Material((0.08, 0.13, 0.28), 0.45, CLOTH_77GHZ, CLOTH_LWIR),
    "cloth_denim": Material((0.105, 0.13, 0.185), 0.50, CLOTH_77GHZ, CLOTH_LWIR),
    "cloth_red": Material((0.38, 0.06, 0.05), 0.50, CLOTH_77GHZ, CLOTH_LWIR),
    "cloth_green": Material((0.06, 0.15, 0.07), 0.45, CLOTH_77GHZ, CLOTH_LWIR),
    "cloth_brown": Material((0.17, 0.105, 0.06), 0.50, CLOTH_77GHZ, CLOTH_LWIR),
    "cloth_yellow": Material((0.62, 0.44, 0.05), 0.65, CLOTH_77GHZ, CLOTH_LWIR),
    "sign_red": Material(
        (0.55, 0.03, 0.03), 0.90, PLATE_77GHZ, SHEET_LWIR, sheeting_reflectance=300.0
    ),
    "sign_white": Material(
        (0.70, 0.70, 0.68), 0.90, PLATE_77GHZ, SHEET_LWIR, sheeting_reflectance=300.0
    ),
    "sign_yellow": Material(
        (0.75, 0.55, 0.03), 0.90, PLATE_77GHZ, SHEET_LWIR, sheeting_reflectance=300.0
    ),
    "signal_red": Material((0.20, 0.015, 0.012), 0.30, PLASTIC_77GHZ, SHEET_LWIR, roughness=0.2),
    "signal_yellow": Material((0.22, 0.12, 0.01), 0.30, PLASTIC_77GHZ, SHEET_LWIR, roughness=0.2),
    "signal_green": Material((0.012, 0.14, 0.09), 0.30, PLASTIC_77GHZ, SHEET_LWIR, roughness=0.2),
    "brick_yellow": Material(
        (0.42, 0.31, 0.18), 0.40, BRICK_77GHZ, WALL_LWIR, texture=Texture.BRICK, maps="brick_yellow"
    ),
    "plaster_grey": Material(
        (0.42, 0.42, 0.41), 0.50, PLASTER_77GHZ, WALL_LWIR, texture=Texture.PLASTER, maps="plaster"
    ),
    "plaster_rose": Material(
        (0.52, 0.33, 0.27), 0.55, PLASTER_77GHZ, WALL_LWIR, texture=Texture.PLASTER, maps="plaster"
    ),
    "roof_slate": Material(
        (0.085, 0.09, 0.10),
        0.20,
        CONCRETE_77GHZ,
        CONCRETE_LWIR,
        roughness=0.7,
        texture=Texture.TILES,
        maps="roof_slate",
    ),
    "water": Material((0.015, 0.025, 0.025), 0.03, WATER_77GHZ, WATER_LWIR, roughness=0.05),
    "sign_blue": Material(
        (0.02, 0.07, 0.32), 0.85, PLATE_77GHZ, SHEET_LWIR, sheeting_reflectance=60.0
    ),
    "grass_blades": Material(
        (0.10, 0.14, 0.045), 0.40, PLANTS_77GHZ, PLANTS_LWIR, texture=Texture.LEAVES
    ),
    # Leaves deep in a crown, with the shade between them; many layers, which let no light through.
    "inner_leaves": Material(
        (0.031, 0.065, 0.017), 0.40, PLANTS_77GHZ, PLANTS_LWIR, texture=Texture.CROWN
    ),
    "inner_needles": Material(
        (0.02, 0.043, 0.017), 0.40, PLANTS_77GHZ, PLANTS_LWIR, texture=Texture.CROWN
    ),
    # Plants in autumn and winter: without chlorophyll as bright at 905 nm, dry ones less.
    "leaves_yellow": Material(
        (0.42, 0.27, 0.03), 0.45, PLANTS_77GHZ, PLANTS_LWIR, texture=Texture.LEAVES
    ),
    "leaves_red": Material(
        (0.26, 0.06, 0.015), 0.45, PLANTS_77GHZ, PLANTS_LWIR, texture=Texture.LEAVES
    ),
    "leaves_brown": Material(
        (0.17, 0.085, 0.03), 0.40, PLANTS_77GHZ, PLANTS_LWIR, texture=Texture.LEAVES
    ),
    "inner_leaves_brown": Material(
        (0.06, 0.042, 0.022), 0.35, PLANTS_77GHZ, PLANTS_LWIR, texture=Texture.CROWN
    ),
    "grass_dull": Material(
        (0.135, 0.125, 0.06), 0.35, PLANTS_77GHZ, PLANTS_LWIR, texture=Texture.GRASS, maps="grass"
    ),
    "grass_blades_dull": Material(
        (0.16, 0.14, 0.07), 0.35, PLANTS_77GHZ, PLANTS_LWIR, texture=Texture.LEAVES
    ),
    # Straw and earth between it; seedlings of winter cereals, which leave half of the earth free.
    "stubble": Material(
        (0.33, 0.275, 0.14), 0.40, PLANTS_77GHZ, PLANTS_LWIR, texture=Texture.CROPS, maps="crops"
    ),
    "young_crops": Material(
        (0.105, 0.125, 0.05), 0.38, PLANTS_77GHZ, PLANTS_LWIR, texture=Texture.CROPS, maps="crops"
    ),
    # Gravel, soil and dust beside roads.
    "roadside_soil": Material(
        (0.195, 0.168, 0.13), 0.28, SOIL_77GHZ, SOIL_LWIR, texture=Texture.SOIL, maps="soil"
    ),
    # Single plants of fields, and the gaps between them, into which hardly any light comes.
    "crop_stalks": Material(
        (0.24, 0.25, 0.075), 0.45, PLANTS_77GHZ, PLANTS_LWIR, texture=Texture.LEAVES
    ),
    "crop_ears": Material(
        (0.37, 0.32, 0.12), 0.47, PLANTS_77GHZ, PLANTS_LWIR, texture=Texture.LEAVES
    ),
    "crop_shade": Material(
        (0.16, 0.15, 0.045), 0.40, PLANTS_77GHZ, PLANTS_LWIR, texture=Texture.CROPS
    ),
    "straw": Material((0.36, 0.30, 0.15), 0.40, PLANTS_77GHZ, PLANTS_LWIR, texture=Texture.LEAVES),
    "seedlings": Material(
        (0.085, 0.14, 0.045), 0.42, PLANTS_77GHZ, PLANTS_LWIR, texture=Texture.LEAVES
    ),
    # Painted sheet with ridges, the walls and roofs of halls.
    "cladding": Material(
        (0.38, 0.40, 0.41), 0.45, METAL_77GHZ, SHEET_LWIR, roughness=0.6, maps="metal_sheet"
    ),
}

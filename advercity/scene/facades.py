"""Builds façades: walls with openings, and the parts in and around these.

A façade is built in its own axes: x along it, z up, its face at y = 0 towards -y. Storeys lie above
each other, each a row of equal bays, so a wall is made of strips between openings and needs no
cutting. Panes close the openings; behind them are blinds, curtains and the far wall of the rooms,
where laser beams end. Cameras see other rooms behind panes, with the same blinds and curtains.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from advercity.assets.lettering import WritingPlane, fit_height, write_text
from advercity.geometry.arrays import Float64Array
from advercity.geometry.mesh import TriangleSurface, join_surfaces
from advercity.geometry.primitives import box, rectangles, tube
from advercity.scene.rooms import (
    BLIND_STEPS,
    COVER_DEPTH_M,
    CURTAIN_FRACTION,
    CURTAINS,
    NO_COVER,
    ROOM_DEPTH_M,
    ROOM_NUMBERS,
    code_blinds,
    code_panes,
)

SurfaceMaterials = list[tuple[TriangleSurface, str]]
"""Surfaces of a building around the origin, with their materials."""

REVEAL_M, FRAME_M, SILL_M = 0.14, 0.06, 0.07
"""Depth of openings, width of frames, and how far sills stand out."""
THRESHOLD_M, TREAD_M = 0.05, 0.3
"""Height of doors above the ground, and depth of a step."""
HANDLE_M, GATE_PANEL_M = 0.12, 0.5
"""Distance of a handle from the middle of a glass door, and height of the panels of a gate."""
SHOP_NAMES = (
    *("BAKERY", "BICYCLES", "BOOKS", "CAFE", "FISHMONGER", "FLOWERS", "HATS", "KEYS"),
    *("MARKET", "OPTICIAN", "PHARMACY", "PIANOS", "SHOES", "TAILOR", "TOYS", "TRAVEL"),
)
SHOP_LETTER_M = 0.32
SHUTTER_FRACTION = 0.34
"""Width of a shutter as a fraction of the window's."""
_LIGHT_ACCENTS = ("cloth_yellow",)
LOWERED_STEPS = 2, 7
"""Least steps of a lowered blind, and one more than the most."""
LIT_ROOM_FRACTION, LIT_SHOP_FRACTION, COOL_FRACTION = 0.35, 0.7, 0.3
"""Fractions of rooms and shops lit by night, and of cool white lamps in rooms (assumptions)."""
CURTAINED_FRACTION = 0.4
"""Fraction of windows without a blind but with a curtain at either side."""


@dataclass(frozen=True)
class Storey:
    """A row of equal openings in a strip of wall.

    Attributes:
        bottom_m: Height of the strip's lower edge above the ground.
        height_m: Height of the strip.
        openings: Number of openings, evenly spaced.
        width_m: Width of an opening.
        sill_m: Height of its lower edge above the strip's.
        opening_m: Height of an opening.
        door_at: Number of the opening with a door down to the strip's lower edge, or None.
        has_balconies: Whether openings lead to balconies.
        is_shop: Whether it has undivided panes, and a sign above them.
        gate_m: Width and height of a gate instead of the door, or None.
    """

    bottom_m: float
    height_m: float
    openings: int
    width_m: float
    sill_m: float
    opening_m: float
    door_at: int | None = None
    has_balconies: bool = False
    is_shop: bool = False
    gate_m: tuple[float, float] | None = None

    @property
    def door_width_m(self) -> float:
        """Width of its door or gate."""
        return self.gate_m[0] if self.gate_m else self.width_m


@dataclass(frozen=True)
class FacadeStyle:
    """Materials and ornaments of a building.

    Attributes:
        wall: Material of the walls.
        trim: Of frames and sills.
        accent: Of shop signs and awnings.
        blind_fraction: Fraction of windows with a blind or curtain.
        has_string_courses: Whether bands run round the building between storeys.
        has_shutters: Whether there are shutters, of the accent's colour, at its windows.
        plinth_m: Height of a plinth before the walls; steps lead to doors above it.
    """

    wall: str
    trim: str
    accent: str
    blind_fraction: float
    has_string_courses: bool = False
    has_shutters: bool = False
    plinth_m: float = 0.0


def build_facade(
    width_m: float, storeys: Sequence[Storey], style: FacadeStyle, draw: np.random.Generator
) -> SurfaceMaterials:
    """Build a façade of a width, with its middle at x = 0, and the far wall of its rooms."""
    parts = build_storeys(width_m, storeys, style, draw)
    top = storeys[-1].bottom_m + storeys[-1].height_m
    rooms = rectangles([(0.0, ROOM_DEPTH_M, top / 2)], (width_m / 2 - 0.3, 0, 0), (0, 0, top / 2))
    return [*parts, (rooms, "plaster")]


def build_storeys(
    width_m: float, storeys: Sequence[Storey], style: FacadeStyle, draw: np.random.Generator
) -> SurfaceMaterials:
    """Build the wall of a façade with its openings alone."""
    parts: SurfaceMaterials = []
    for storey in storeys:
        parts += _build_storey(width_m, storey, style, draw)
    return parts


def _build_storey(
    width_m: float, storey: Storey, style: FacadeStyle, draw: np.random.Generator
) -> SurfaceMaterials:
    middles = _place_openings(width_m, storey)
    is_door = np.arange(storey.openings) == storey.door_at
    widths = np.where(is_door, storey.door_width_m, storey.width_m)
    low = storey.bottom_m + np.where(is_door, max(THRESHOLD_M, style.plinth_m), storey.sill_m)
    high = np.full(len(middles), storey.bottom_m + storey.sill_m + storey.opening_m)
    if storey.gate_m:
        high[is_door] = storey.bottom_m + storey.gate_m[1]
    parts = [
        (_build_wall(width_m, storey, middles, widths, low, high), style.wall),
        (_build_reveals(middles, widths, low, high), style.wall),
    ]
    windows = ~is_door
    centres = np.column_stack([middles, np.full(len(middles), REVEAL_M), (low + high) / 2])
    half = np.column_stack([np.zeros((len(middles), 2)), (high - low) / 2])
    if windows.any():
        parts += _fill_windows(centres[windows], half[windows], storey, style, draw)
    if is_door.any():
        parts += _fill_doors(centres[is_door], half[is_door], storey, style, draw)
    if style.has_string_courses:
        parts.append((_build_band(width_m, storey.bottom_m + storey.height_m, 0.16), style.trim))
    return parts


def _place_openings(width_m: float, storey: Storey) -> Float64Array:
    """Place the middles (n,) of a storey's openings along the façade."""
    bay = width_m / storey.openings
    number = np.arange(storey.openings, dtype=np.float64)
    return (number - (storey.openings - 1) / 2) * bay


def _build_wall(
    width_m: float,
    storey: Storey,
    middles: Float64Array,
    widths: Float64Array,
    low: Float64Array,
    high: Float64Array,
) -> TriangleSurface:
    """Build the strips of wall: piers between openings, and the wall below and above each."""
    bottom, top = storey.bottom_m, storey.bottom_m + storey.height_m
    sides = middles - widths / 2, middles + widths / 2
    left = np.concatenate([[-width_m / 2], sides[1]])
    right = np.concatenate([sides[0], [width_m / 2]])
    edges = [(left, right, np.full(len(left), bottom), np.full(len(left), top))]
    edges += [
        (*sides, np.full(len(middles), bottom), low),
        (*sides, high, np.full(len(middles), top)),
    ]
    west, east, down, up = (np.concatenate(column) for column in zip(*edges, strict=True))
    zero = np.zeros(len(west))
    return rectangles(
        np.column_stack([(west + east) / 2, zero, (down + up) / 2]),
        np.column_stack([(east - west) / 2, zero, zero]),
        np.column_stack([zero, zero, (up - down) / 2]),
    )


def _build_reveals(
    middles: Float64Array, widths: Float64Array, low: Float64Array, high: Float64Array
) -> TriangleSurface:
    """Build the sides of openings, from the wall to the panes."""
    depth = REVEAL_M / 2
    zero = np.zeros(len(middles))
    at, half = np.full(len(middles), depth), (high - low) / 2
    upright, across = (np.column_stack(v) for v in ((zero, zero, half), (widths / 2, zero, zero)))
    left, right = middles - widths / 2, middles + widths / 2
    level = (0.0, depth, 0.0)
    return join_surfaces(
        [
            rectangles(np.column_stack([left, at, low + half]), level, upright),
            rectangles(np.column_stack([right, at, low + half]), (0, -depth, 0), upright),
            rectangles(np.column_stack([middles, at, low]), across, level),
            rectangles(np.column_stack([middles, at, high]), across, (0, -depth, 0)),
        ]
    )


def _fill_windows(
    centres: Float64Array,
    half: Float64Array,
    storey: Storey,
    style: FacadeStyle,
    draw: np.random.Generator,
) -> SurfaceMaterials:
    """Fill openings (n, 3), of half heights (n, 3), with panes, frames, blinds and sills."""
    width = storey.width_m
    is_lit = draw.random(len(centres)) < (
        LIT_SHOP_FRACTION if storey.is_shop else LIT_ROOM_FRACTION
    )
    covers = _draw_covers(len(centres), storey, style, draw)
    parts: SurfaceMaterials = [
        *_build_panes(centres, half, is_lit, covers, storey, draw),
        *_build_covers(centres, half, width, covers),
        (_build_frames(centres, half, width, has_mullion=not storey.is_shop), style.trim),
    ]
    if storey.is_shop:
        return [*parts, *_build_shop_front(centres, half, width, style, draw)]
    if style.has_shutters:
        parts.append((_build_shutters(centres, half, width), style.accent))
    if storey.has_balconies:
        return [*parts, *_build_balconies(centres - half, width)]
    sills = [
        box(
            (x - width / 2 - 0.06, -SILL_M, z - SILL_M),
            (x + width / 2 + 0.06, REVEAL_M - 0.02, z + 0.02),
        )
        for x, _, z in centres - half
    ]
    return [*parts, (join_surfaces(sills), style.trim)]


def _draw_covers(
    count: int, storey: Storey, style: FacadeStyle, draw: np.random.Generator
) -> NDArray[np.int64]:
    """Draw the cover of each pane, in the codes of `scene.rooms`; none in shops."""
    blinds = code_blinds(draw.integers(*LOWERED_STEPS, count))
    curtains = np.where(draw.random(count) < CURTAINED_FRACTION, CURTAINS, NO_COVER)
    covers = np.where(draw.random(count) < style.blind_fraction, blinds, curtains)
    return np.where(storey.is_shop, NO_COVER, covers)


def _build_panes(
    centres: Float64Array,
    half: Float64Array,
    is_lit: NDArray[np.bool_],
    covers: NDArray[np.int64],
    storey: Storey,
    draw: np.random.Generator,
) -> SurfaceMaterials:
    """Build a pane in each opening, of the material of the room behind it."""
    is_cool = draw.random(len(centres)) < COOL_FRACTION
    numbers = draw.integers(ROOM_NUMBERS, size=len(centres))
    kinds = (
        ("shop_dark", ~is_lit & storey.is_shop),
        ("room_dark", ~is_lit & (not storey.is_shop)),
        ("room_shop", is_lit & storey.is_shop),
        ("room_warm", is_lit & ~is_cool & (not storey.is_shop)),
        ("room_cool", is_lit & is_cool & (not storey.is_shop)),
    )
    return [
        (
            replace(
                rectangles(centres[chosen], (storey.width_m / 2, 0, 0), half[chosen]),
                uv=code_panes(numbers[chosen], covers[chosen]),
            ),
            material,
        )
        for material, chosen in kinds
        if chosen.any()
    ]


def _build_covers(
    centres: Float64Array, half: Float64Array, width_m: float, covers: NDArray[np.int64]
) -> SurfaceMaterials:
    """Build blinds and curtains behind panes, which laser beams get through."""
    behind = centres + np.array([0.0, COVER_DEPTH_M, 0.0])
    is_drawn, is_blind = covers == CURTAINS, covers > CURTAINS
    covered = half * ((covers - CURTAINS) / BLIND_STEPS)[:, None]
    raised = behind + half - covered
    curtain = CURTAIN_FRACTION * width_m / 2
    aside = np.array([width_m / 2 - curtain, 0.0, 0.0])
    cloths = [rectangles(raised[is_blind], (width_m / 2, 0, 0), covered[is_blind])]
    cloths += [
        rectangles(behind[is_drawn] + side * aside, (curtain, 0, 0), half[is_drawn])
        for side in (-1, 1)
    ]
    return [(join_surfaces(cloths), "cloth_light")] if (covers != NO_COVER).any() else []


def _build_frames(
    centres: Float64Array, half: Float64Array, width_m: float, *, has_mullion: bool
) -> TriangleSurface:
    """Build the frames of windows before their panes, with a mullion in the middle."""
    at = centres - (0.0, 0.02, 0.0)
    side, post = (width_m - FRAME_M) / 2, (FRAME_M / 2, 0, 0)
    rail = np.array([0.0, 0.0, FRAME_M / 2])
    bars = [
        rectangles(at - (side, 0, 0), post, half),
        rectangles(at + np.array([side, 0, 0]), post, half),
        rectangles(at - half + rail, (width_m / 2, 0, 0), rail),
        rectangles(at + half - rail, (width_m / 2, 0, 0), rail),
    ]
    if has_mullion:
        bars.append(rectangles(at, post, half))
    return join_surfaces(bars)


def _build_shutters(centres: Float64Array, half: Float64Array, width_m: float) -> TriangleSurface:
    """Build an open shutter on either side of each window, on the wall."""
    leaf = SHUTTER_FRACTION * width_m / 2
    aside, on_wall = np.array([width_m / 2 + leaf + 0.03, 0, 0]), (0, -REVEAL_M - 0.03, 0)
    return join_surfaces(
        [rectangles(centres + side * aside + on_wall, (leaf, 0, 0), half) for side in (-1, 1)]
    )


def _build_shop_front(
    centres: Float64Array,
    half: Float64Array,
    width_m: float,
    style: FacadeStyle,
    draw: np.random.Generator,
) -> SurfaceMaterials:
    """Build the sign above a row of shop windows, and an awning over some."""
    top = float((centres + half)[0, 2])
    low, high = float(centres[:, 0].min() - width_m / 2), float(centres[:, 0].max() + width_m / 2)
    sign = box((low, -0.12, top + 0.08), (high, -0.005, top + 0.55))
    awnings = [_build_awning(x, width_m, top) for x in centres[:, 0] if draw.random() < 0.35]
    word = str(draw.choice(SHOP_NAMES))
    height_m = fit_height(word, SHOP_LETTER_M, 0.9 * (high - low))
    plane = WritingPlane(((low + high) / 2, -0.12, top + 0.32), (1.0, 0.0, 0.0))
    name = write_text(word, plane, height_m)
    lettering = "black_plastic" if style.accent in _LIGHT_ACCENTS else "enamel_white"
    parts: SurfaceMaterials = [(sign, style.accent), (name, lettering)]
    return [*parts, (join_surfaces(awnings), style.accent)] if awnings else parts


def _build_awning(x: float, width_m: float, top_m: float) -> TriangleSurface:
    """Build a sloping sheet of cloth, seen from above and below."""
    middle, across = (x, -0.6, top_m - 0.12), np.array([width_m / 2, 0.0, 0.0])
    slope = np.array([0.0, 0.6, 0.28])
    return join_surfaces(
        [rectangles([middle], across, slope), rectangles([middle], -across, slope)]
    )


def _build_balconies(feet: Float64Array, width_m: float) -> SurfaceMaterials:
    """Build a slab with a railing before each window, whose lower edge is at `feet` (n, 3)."""
    half, deep = width_m / 2 + 0.5, 1.1
    slabs, rails = [], []
    for x, _, z in feet:
        slabs.append(box((x - half, -deep, z - 0.16), (x + half, 0.0, z - 0.01)))
        rails += [
            box((x - half, -deep, z), (x + half, -deep + 0.04, z + 0.95)),
            box((x - half, -deep, z), (x - half + 0.04, 0.0, z + 0.95)),
            box((x + half - 0.04, -deep, z), (x + half, 0.0, z + 0.95)),
        ]
    return [(join_surfaces(slabs), "concrete"), (join_surfaces(rails), "metal")]


def _fill_doors(
    centres: Float64Array,
    half: Float64Array,
    storey: Storey,
    style: FacadeStyle,
    draw: np.random.Generator,
) -> SurfaceMaterials:
    """Fill openings with a gate, or a door with a canopy, and steps if there is a plinth."""
    width = storey.door_width_m
    if storey.gate_m:
        gate = rectangles(centres, (width / 2, 0, 0), half)
        return [(join_surfaces([gate, _build_gate_ribs(centres, half, width)]), style.trim)]
    canopies = [
        box((x - width / 2 - 0.25, -0.75, z), (x + width / 2 + 0.25, 0.0, z + 0.12))
        for x, _, z in centres + half + np.array([0.0, 0.0, 0.1])
    ]
    steps = [
        box((x - width / 2 - 0.2, -count * TREAD_M, -0.5), (x + width / 2 + 0.2, 0.0, z))
        for x, _, top in centres - half
        for count, z in ((1, top), (2, top / 2))
        if style.plinth_m
    ]
    leaves = _build_glass_doors if storey.is_shop else _build_doors
    return [
        *leaves(centres, half, storey, draw),
        (_build_frames(centres, half, width, has_mullion=storey.is_shop), style.trim),
        (join_surfaces([*canopies, *steps]), "concrete"),
    ]


def _build_doors(
    centres: Float64Array, half: Float64Array, storey: Storey, _: np.random.Generator
) -> SurfaceMaterials:
    across, light = (storey.width_m / 2 - FRAME_M, 0, 0), half * 0.16
    return [
        (rectangles(centres - light, across, half - light), "wood"),
        (rectangles(centres + half - light, across, light), "glass"),
    ]


def _build_glass_doors(
    centres: Float64Array, half: Float64Array, storey: Storey, draw: np.random.Generator
) -> SurfaceMaterials:
    """Build the two glass leaves of shop doors, each with a handle."""
    is_lit = draw.random(len(centres)) < LIT_SHOP_FRACTION
    covers = np.full(len(centres), NO_COVER)
    handles = [
        tube([(x + side * HANDLE_M, y - 0.06, z + end) for end in (-0.4, 0.4)], 0.018, sides=5)
        for x, y, z in centres
        for side in (-1, 1)
    ]
    return [
        *_build_panes(centres, half, is_lit, covers, storey, draw),
        (join_surfaces(handles), "metal"),
    ]


def _build_gate_ribs(centres: Float64Array, half: Float64Array, width_m: float) -> TriangleSurface:
    ribs = [
        box((x - width_m / 2, y - 0.03, z + at), (x + width_m / 2, y, z + at + 0.06))
        for (x, y, z), (*_, rise) in zip(centres, half, strict=True)
        for at in np.arange(-rise + GATE_PANEL_M, rise - 0.06, GATE_PANEL_M)
    ]
    return join_surfaces(ribs)


def _build_band(width_m: float, height_m: float, rise_m: float) -> TriangleSurface:
    """Build a band projecting from the wall, below a height."""
    return box((-width_m / 2, -0.06, height_m - rise_m), (width_m / 2, 0.0, height_m))

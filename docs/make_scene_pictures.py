"""Renders the pictures of plants and buildings of docs/bodies.md.

python docs/make_scene_pictures.py [FOLDER [NAME ...]]
"""

import sys
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import shapely
from advercity_dsl.road import BuildingUse, Roof, Season, Species, Surrounding, SurroundingKind

from advercity.compiler.library import find_weather
from advercity.frames import Frame
from advercity.geometry import poses
from advercity.geometry.arrays import Uint8Array
from advercity.geometry.mesh import MeshPart, build_meshes
from advercity.media import draw_label_bar
from advercity.physics.atmosphere import compute_atmosphere
from advercity.pipeline.body_sheet import build_ground, take_photograph
from advercity.pipeline.surface_maps import SurfaceMaps
from advercity.rendering.backend import RENDER_PROFILES, Backend, CameraView, load_backend
from advercity.scene import buildings, crops, footprints, roadside, skyline, vegetation, woods
from advercity.scene.buildings import Lot
from advercity.scene.seasons import apply_season
from advercity.scene.site import Rectangle, Site
from advercity.scene.verges import build_verges
from advercity.semantics import Semantic
from advercity.world import StreetLamp, World

CELL_PX, FIELD_OF_VIEW_RAD = (400, 400), np.radians(36.0)
SPACING_M = 40.0
"""Distance of what is shown from its neighbours, so that none is in the picture of another."""
EYE_M = 1.7
GROUND_RATIO = np.float32(4.0)
AZIMUTH_DEG = 25.0
JPEG_QUALITY = 80
SCALE = 0.6

OUTLINED: tuple[tuple[BuildingUse | None, Roof], ...] = (
    ("commercial", "flat"),
    ("residential", "hipped"),
    ("industrial", "gabled"),
    (None, "gabled"),
)
"""Uses and roofs of buildings on outlines."""
Builder = Callable[[float, Site], list[MeshPart]]
"""Builds something at an x, north of the street at y = 0."""
Item = tuple[str, float, Builder]
"""A label, the extent in metres that fills the image, and what builds it."""


def main() -> None:
    """Write the pictures that are named, or both."""
    home = Path(__file__).parent / "images/bodies"
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else home
    sheets = {"plants": draw_plants, "buildings": draw_buildings}
    folder.mkdir(parents=True, exist_ok=True)
    backend = load_backend("sapien")
    for name in sys.argv[2:] or sheets:
        sheet = sheets[name](backend)
        picture = cv2.resize(sheet, None, fx=SCALE, fy=SCALE, interpolation=cv2.INTER_AREA)
        options = [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY]
        _, content = cv2.imencode(".jpg", picture.astype(np.uint8), options)
        (folder / f"{name}.jpg").write_bytes(content.tobytes())


def draw_plants(backend: Backend) -> Uint8Array:
    """Draw an image (h, w, 3), BGR: a row for each kind, what it is near, farther and by season."""
    trees: list[list[Item]] = [
        [
            (f"{species}, {away_m:.0f} m off", 6.5, plant_tree(species, away_m))
            for species in Species
        ]
        for away_m in (9.0, 20.0, 40.0)
    ]
    others: list[Item] = [
        ("hedge", 5.0, plant_hedge),
        ("wood", 24.0, plant_wood),
        ("crops", 5.0, sow_crops),
        ("row of trees", 16.0, plant_row),
        ("verge", 2.5, grow_verge),
    ]
    summer = [render_row(row, "clear_day", backend) for row in [*trees, others]]
    later = [
        render_row(name_season(row, season), "clear_day", backend, season)
        for season in (Season.AUTUMN, Season.WINTER)
        for row in (trees[0], others)
    ]
    return np.vstack([*summer, *later])


def name_season(items: Sequence[Item], season: Season) -> list[Item]:
    """Add a season to labels."""
    return [(f"{label}, {season}", extent_m, build) for label, extent_m, build in items]


def draw_buildings(backend: Backend) -> Uint8Array:
    """Draw an image (h, w, 3), BGR: buildings of every kind by day and by night."""
    rows: list[list[Item]] = [
        [(f"town block {number}", 19.0, build_block(number)) for number in range(5)],
        [(f"house {number}", 11.0, build_house(number)) for number in range(5)],
        [
            *(
                (f"{use or 'block'}, {roof} roof", 19.0, build_outlined(use, roof))
                for use, roof in OUTLINED
            ),
            ("skyline", 60.0, build_far_town),
        ],
    ]
    return np.vstack(
        [render_row(row, name, backend) for row in rows for name in ("clear_day", "clear_night")]
    )


def render_row(
    items: Sequence[Item], weather_id: str, backend: Backend, season: Season = Season.SUMMER
) -> Uint8Array:
    """Render things side by side, each with a label above it."""
    places = SPACING_M * np.arange(len(items))
    site = build_site(float(places[-1]), season)
    parts = [build(float(x), site) for (_, _, build), x in zip(items, places, strict=True)]
    world = build_world([part for group in parts for part in group], places.tolist(), season)
    atmosphere = compute_atmosphere(find_weather(weather_id).declaration, "rural")
    cells: list[Uint8Array] = []
    with backend.open(world, atmosphere, RENDER_PROFILES["preview"]) as renderer:
        renderer.place(Frame(index=0, time_s=0.0, states=(), signals={}))
        for (label, extent_m, _), group in zip(items, parts, strict=True):
            view = aim_camera(group, extent_m)
            cells.append(
                np.vstack([draw_label_bar(label, CELL_PX[0]), take_photograph(renderer, view)])
            )
    return np.hstack(cells)


def build_site(length_m: float, season: Season) -> Site:
    """Build level ground along a street at y = 0."""
    axis = shapely.LineString([(-SPACING_M, 0.0), (length_m + SPACING_M, 0.0)])
    paved = axis.buffer(3.5, cap_style="flat")
    return Site(lambda points: np.zeros(len(points)), paved, axis, paved, season)


def build_world(parts: Sequence[MeshPart], lit_at: Sequence[float], season: Season) -> World:
    """Build the world of things on grass, with street lamps at some x."""
    plain = build_ground()
    ground = replace(
        plain, vertices=GROUND_RATIO * plain.vertices, material="grass", semantic=Semantic.TERRAIN
    )
    return World(
        id="sheet",
        static=tuple(apply_season([ground, *build_meshes(parts)], season)),
        bodies={},
        lanes=(),
        street_lamps=tuple(StreetLamp((float(x), 3.5, 8.0)) for x in lit_at),
        network=Path(),
        material_maps=SurfaceMaps({}),
    )


def aim_camera(parts: Sequence[MeshPart], extent_m: float) -> CameraView:
    """Place a camera on the street side of things so far away that an extent fills the image."""
    corners = np.concatenate([part.surface.vertices for part in parts])
    low, high = corners.min(axis=0), corners.max(axis=0)
    away_m = 0.55 * extent_m / np.tan(FIELD_OF_VIEW_RAD / 2)
    turn = np.radians(AZIMUTH_DEG)
    middle = (low + high) / 2
    front = np.array([middle[0], max(low[1], middle[1] - extent_m / 2), middle[2]])
    place = front + away_m * np.array([np.sin(turn), -np.cos(turn), 0.0])
    place[2] = EYE_M
    along = front - place
    pitch = -float(np.arctan2(along[2], np.hypot(*along[:2])))
    pose = poses.pose_matrix(place, yaw=float(np.arctan2(along[1], along[0])), pitch=pitch)
    return CameraView(pose, *CELL_PX, FIELD_OF_VIEW_RAD)


def plant_tree(species: Species, away_m: float) -> Builder:
    """Return what plants a tree at a distance from the street, which decides how fine it is."""
    return lambda x, site: vegetation.build_trees(
        np.array([[x, away_m]]), None, site, f"sheet/{species}", (species,)
    )


def plant_row(x: float, site: Site) -> list[MeshPart]:
    """Plant five trees of any species along the street."""
    places = np.column_stack([x + 7.0 * np.arange(-2, 3), np.full(5, 12.0)])
    return vegetation.build_trees(places, None, site, "sheet/row")


def plant_hedge(x: float, site: Site) -> list[MeshPart]:
    """Plant a clipped hedge along the street."""
    return roadside.build_hedge([(x - 3.0, 10.0), (x + 3.0, 10.0)], None, site, "sheet")


def plant_wood(x: float, site: Site) -> list[MeshPart]:
    """Plant a wood."""
    area = Rectangle.from_corners(((x - 14.0, 60.0), (x + 14.0, 90.0)))
    return woods.build_woods(area, None, site, "sheet")


def sow_crops(x: float, site: Site) -> list[MeshPart]:
    """Sow a field of crops."""
    area = Rectangle.from_corners(((x - 15.0, 8.0), (x + 15.0, 40.0)))
    return crops.build_crops(crops.sample_rows(area), None, site, "sheet")


def grow_verge(x: float, site: Site) -> list[MeshPart]:
    """Grow the grass beside the street."""
    here = shapely.box(x - 8.0, -8.0, x + 8.0, 8.0)
    paved = shapely.intersection(site.paved_area, here)
    near = replace(site, paved_area=paved, reserved_area=paved)
    return build_verges(paved, near, "sheet")


def build_block(number: int) -> Builder:
    """Return what builds a town block; all else of it is drawn."""
    lot = (18.0, 15.0)
    return lambda x, site: buildings.build_town_blocks(
        [Lot((x, 20.0), 0.0, *lot)], 12.0, site, f"sheet/{number}"
    )[0]


def build_house(number: int) -> Builder:
    """Return what builds a house with its hedges and its tree."""
    lot = (10.0, 8.5)
    return lambda x, site: buildings.build_houses(
        [Lot((x, 15.0), 0.0, *lot)], None, site, f"sheet/{number}"
    )[0]


def build_outlined(use: BuildingUse | None, roof: Roof) -> Builder:
    """Return what builds on an outline, as buildings of maps are built."""

    def build(x: float, site: Site) -> list[MeshPart]:
        outline = ((x - 9.0, 10.0), (x + 9.0, 10.0), (x + 9.0, 26.0), (x - 9.0, 26.0))
        declared = Surrounding(
            kind=SurroundingKind.BUILDINGS, line_m=outline, use=use, roof=roof, height_m=11.0
        )
        return footprints.build_on_footprint(declared, site, f"sheet/{use}/{roof}")

    return build


def build_far_town(x: float, site: Site) -> list[MeshPart]:
    """Build a town as it is built where it is seen from afar."""
    area = Rectangle.from_corners(((x - 30.0, 30.0), (x + 30.0, 90.0)))
    return list(skyline.build_skyline(area, None, site, "sheet"))


if __name__ == "__main__":
    main()

"""The part of a model that can be seen from outside, every triangle facing who sees it.

What the materials of foreign models stand for here, told from their names.

From a foreign model to ours: upright, facing x, in metres, what is seen of it, in few parts.

A converted model is a GLB whose meshes are named after our materials, x forward, y left, z up.
"""

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import cast

import fast_simplification
import numpy as np
import trimesh
from advercity_dsl.catalogue import BodyModel, MaterialPart
from numpy.typing import NDArray
from trimesh.ray.ray_pyembree import RayMeshIntersector

from advercity.assets import model_files
from advercity.assets.model_files import ModelPart
from advercity.assets.model_wheels import separate_wheels
from advercity.errors import RunError
from advercity.geometry.arrays import Float64Array
from advercity.geometry.mesh import Size
from advercity.materials import ACTOR_PAINT

SKY_DIRECTION_COUNT = 64
SAMPLE_BARYCENTRICS = np.array([(1, 1, 1), (4, 1, 1), (1, 4, 1), (1, 1, 4)]) / np.array(
    [[3], [6], [6], [6]]
)
"""Barycentric places on a triangle from where the sky is looked for."""
RAY_OFFSET_M = 2e-3


def find_visible_sides(
    vertices: Float64Array, triangles: NDArray[np.int64], min_elevation_sine: float
) -> tuple[NDArray[np.bool_], ...]:
    """Whether each triangle can be seen from in front, and from behind.

    A side can be seen if from some place on it a ray gets away, over its own horizon.

    Args:
        vertices: (n, 3) metres, z up.
        triangles: (m, 3).
        min_elevation_sine: Sine of the steepest look upwards.
    """
    world = RayMeshIntersector(trimesh.Trimesh(vertices, triangles, process=False))
    corners = vertices[triangles]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-12)
    sides = []
    for sign in (1.0, -1.0):
        free = np.zeros(len(triangles), dtype=bool)
        for place in SAMPLE_BARYCENTRICS:
            start = np.einsum("k,nkd->nd", place, corners) + sign * RAY_OFFSET_M * normal
            for direction in _sample_sky_directions(min_elevation_sine):
                ask = np.flatnonzero(~free & (sign * (normal @ direction) > 0.05))
                if len(ask):
                    ahead = np.broadcast_to(direction, (len(ask), 3))
                    free[ask] = ~world.intersects_any(start[ask], ahead)
        sides.append(free)
    return tuple(sides)


def _sample_sky_directions(lowest: float) -> Float64Array:
    """Directions (k, 3), evenly spread over the sky down to the sine of an elevation."""
    index = np.arange(SKY_DIRECTION_COUNT) + 0.5
    azimuth = np.pi * (1.0 + np.sqrt(5.0)) * index
    height = 1.0 - (1.0 - lowest) * index / SKY_DIRECTION_COUNT
    level = np.sqrt(1.0 - height**2)
    return np.column_stack([level * np.cos(azimuth), level * np.sin(azimuth), height])


LENS_PARTS = frozenset({"glass", "headlamp", "tail_lamp"})
"""Parts whose place on the body says what they really are."""
MATERIAL_BY_PART: dict[str, str] = {
    "paint": ACTOR_PAINT,
    "white_paint": "car_paint_white",
    "black_paint": "car_paint_black",
    "red_paint": "car_paint_red",
    "blue_paint": "car_paint_blue",
    "glass": "glass",
    "rubber": "rubber",
    "chrome": "chrome",
    "metal": "metal",
    "plastic": "black_plastic",
    "interior": "upholstery",
    "plate": "licence_plate",
    "headlamp": "lamp_white",
    "tail_lamp": "lamp_red",
    "indicator": "lamp_amber",
}
"""Key of MATERIALS of every part that is kept."""

_PART_PATTERNS: tuple[tuple[str, MaterialPart], ...] = (
    (r"tail|brake.?light|rear.?light|back.?light|red.?light|glass_red", "tail_lamp"),
    (r"turn|indicator|blinker|orange.?light", "indicator"),
    (r"head.?l|front.?light|focus|reflector|parking_light|lamp", "headlamp"),
    (r"licen[sc]e|plate|number", "plate"),
    (r"glass|window|crystal|windscreen|windshield", "glass"),
    (r"tire|tyre|rubber", "rubber"),
    (r"interior|seat|inside|steering|floor|upholst", "interior"),
    (r"chrome|mirror|alumin", "chrome"),
    (r"paint|first.?colou?r|exterior|body|shell", "paint"),
    (r"wheel|rim|metal|steel", "metal"),
)


def classify_material(name: str, declared: Mapping[str, MaterialPart]) -> MaterialPart:
    """What a material stands for: as declared, else as its name tells, else plastic."""
    if name in declared:
        return declared[name]
    for pattern, part in _PART_PATTERNS:
        if re.search(pattern, name.lower()):
            return part
    return "plastic"


def classify_triangles_by_colour(part: model_files.ModelPart) -> NDArray[np.str_]:
    """What each triangle (m,) of a part stands for that one texture paints all over.

    Such a part holds what is neither bodywork nor window: lamps, plates, trim, the rims of wheels,
    which alone face sideways.
    """
    if part.colours is None:
        return np.full(len(part.triangles), "plastic")
    red, green, blue = part.colours.T
    is_red = (red > 0.3) & (red > 1.8 * green) & (red > 1.8 * blue)
    is_amber = (red > 0.5) & (green > 0.25) & (blue < 0.45 * red) & ~is_red
    is_light = part.colours.mean(axis=1) > 0.45
    corners = part.vertices[part.triangles]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    is_rim = np.abs(normal[:, 1]) > 0.85 * np.linalg.norm(normal, axis=1)
    is_lamp = is_light & ~is_rim & (corners[:, :, 0].mean(axis=1) > 0.0)
    kinds = [is_red & ~is_rim, is_amber, is_lamp, part.colours.mean(axis=1) > 0.3]
    return np.select(kinds, ["tail_lamp", "indicator", "headlamp", "metal"], "plastic")


def correct_parts_by_position(
    stands_for: NDArray[np.str_], part: model_files.ModelPart, size: tuple[float, float, float]
) -> NDArray[np.str_]:
    """What triangles (m,) stand for once it counts where on a body of this size they are.

    White lamps are at the front, to the sides; red ones are at the back; and low panes at either
    end are the covers of lamps.
    """
    middle = np.abs(part.vertices[part.triangles].mean(axis=1)) / np.maximum(size, 1e-9)
    along = part.vertices[part.triangles].mean(axis=1)[:, 0] / size[0]
    across, height = middle[:, 1], middle[:, 2]
    is_cover = (stands_for == "glass") & (np.abs(along) > 0.36) & (height < 0.5)
    lamp = np.where(along > 0.0, "headlamp", "tail_lamp")
    placed = np.where(is_cover | (stands_for == "headlamp"), lamp, stands_for)
    is_white = (placed == "headlamp") & (along > 0.2) & (across > 0.18) & (height < 0.65)
    is_red = (placed == "tail_lamp") & (along < -0.2)
    placed = np.where((placed == "headlamp") & ~is_white, "metal", placed)
    return np.where((placed == "tail_lamp") & ~is_red, "plastic", placed)


CONVERSION_VERSION = 2
"""Of this conversion; another one makes other files of the same models."""
PROPORTION_TOLERANCE = 0.25
"""By how much a model's proportions may differ from its blueprint's before it is turned wrong."""
WELD_FRACTION = 5e-5
"""Of the model's length: vertices nearer than this are one."""
SHAPE_MATERIALS = frozenset({ACTOR_PAINT, "glass", "lamp_white", "lamp_red"})
"""What people know a vehicle by; it is thinned less than the rest."""
SHAPE_WEIGHT = 3.0
BODY_MIN_ELEVATION_SINE, WHEEL_MIN_ELEVATION_SINE = -0.25, -1.0
"""Nobody looks at cars from underneath, but wheels turn."""
MIN_PART_TRIANGLES = 24
"""Triangles that are left of any part."""


def convert_model(parts: Iterable[ModelPart], model: BodyModel, size: Size) -> list[ModelPart]:
    """The parts that are seen of a model, in our frame and of our materials.

    Args:
        parts: As they are in its file.
        model: How to take them.
        size: Full length, width and height of the blueprint in metres, which it is scaled to.

    Raises:
        RunError: Nothing is left, or its proportions are another thing's.
    """
    kept = [part for part in parts if classify_material(part.material, model.materials) != "none"]
    if not kept:
        raise RunError(f"{format_model_name(model)}: no material of it stands for any part")
    upright = [_turn_upright(part, model) for part in kept]
    rest, wheels = separate_wheels(_scale_to_size(upright, model, size))
    outside = _keep_visible(_group_by_material(rest, model, size), BODY_MIN_ELEVATION_SINE)
    for number, own in enumerate(wheels, start=1):
        turning = _keep_visible(_group_by_material(own, model, size), WHEEL_MIN_ELEVATION_SINE)
        outside += [replace(part, wheel=number) for part in turning]
    return _simplify_parts(outside, model.triangles)


def format_model_name(model: BodyModel) -> str:
    """Of a model, for people."""
    return model.pack or model.file or "model"


def _turn_upright(part: ModelPart, model: BodyModel) -> ModelPart:
    x, y, z = part.vertices.T
    if model.up == "y":
        x, y, z = z, x, y
    turn = np.radians(model.turn_deg)
    cosine, sine = np.cos(turn), np.sin(turn)
    vertices = np.column_stack([x * cosine - y * sine, x * sine + y * cosine, z])
    return ModelPart(part.material, vertices, part.triangles, part.colours)


def _scale_to_size(parts: Sequence[ModelPart], model: BodyModel, size: Size) -> list[ModelPart]:
    """The parts scaled to the size, standing on the origin."""
    used = np.concatenate([part.vertices[part.triangles].reshape(-1, 3) for part in parts])
    low, high = used.min(axis=0), used.max(axis=0)
    factor = np.asarray(size) / np.maximum(high - low, 1e-9)
    stretch = factor / np.median(factor)
    if np.abs(stretch - 1.0).max() > PROPORTION_TOLERANCE:
        found = " x ".join(f"{extent:.3g}" for extent in high - low)
        raise RunError(
            f"{format_model_name(model)}: is {found} (length, width, height in its own unit),"
            f" which does not fit {size[0]:g} x {size[1]:g} x {size[2]:g} m; set `turn_deg`"
            " and `up` so that its front faces along x and its roof up"
        )
    middle = (low + high) / 2 * (1, 1, 0) + low * (0, 0, 1)
    return [
        ModelPart(part.material, (part.vertices - middle) * factor, part.triangles, part.colours)
        for part in parts
    ]


def _group_by_material(parts: Sequence[ModelPart], model: BodyModel, size: Size) -> list[ModelPart]:
    """One part for each of our materials."""
    found: dict[str, list[ModelPart]] = {}
    for part in parts:
        named = classify_material(part.material, model.materials)
        stands_for = (
            classify_triangles_by_colour(part)
            if named == "by_colour"
            else np.full(len(part.triangles), named)
        )
        if named in LENS_PARTS or named == "by_colour":
            stands_for = correct_parts_by_position(stands_for, part, size)
        for kind in np.unique(stands_for):
            material = MATERIAL_BY_PART[kind]
            triangles = part.triangles[stands_for == kind]
            found.setdefault(material, []).append(ModelPart(material, part.vertices, triangles))
    return [_weld_parts(material, some) for material, some in sorted(found.items())]


def _weld_parts(material: str, parts: Sequence[ModelPart]) -> ModelPart:
    """One part of several, with one vertex where theirs meet."""
    corners = np.concatenate([part.vertices[part.triangles] for part in parts]).reshape(-1, 3)
    grid = np.round(corners / (WELD_FRACTION * np.ptp(corners, axis=0).max() + 1e-6)).astype(
        np.int64
    )
    _, first, index = np.unique(grid, axis=0, return_index=True, return_inverse=True)
    triangles = index.reshape(-1, 3)
    a, b, c = triangles.T
    return ModelPart(material, corners[first], triangles[(a != b) & (b != c) & (c != a)])


def _keep_visible(parts: Sequence[ModelPart], lowest: float) -> list[ModelPart]:
    """What can be seen of the parts, each triangle facing who sees it; thin sheets face both.

    `lowest` is the sine of the steepest look upwards.
    """
    starts = np.cumsum([0, *(len(part.vertices) for part in parts)])
    vertices = np.concatenate([part.vertices for part in parts])
    triangles = np.concatenate(
        [part.triangles + start for part, start in zip(parts, starts, strict=False)]
    )
    front, back = find_visible_sides(vertices, triangles, lowest)
    bounds = np.cumsum([0, *(len(part.triangles) for part in parts)])
    kept: list[ModelPart] = []
    for part, first, last in zip(parts, bounds[:-1], bounds[1:], strict=True):
        ahead, behind = front[first:last], back[first:last]
        faces = np.concatenate([part.triangles[ahead], part.triangles[behind][:, ::-1]])
        if len(faces):
            kept.append(
                _weld_parts(part.material, [ModelPart(part.material, part.vertices, faces)])
            )
    return kept


def _simplify_parts(parts: Sequence[ModelPart], budget: int) -> list[ModelPart]:
    """The parts with about `budget` triangles in all; what makes the shape loses the fewest."""
    total = sum(len(part.triangles) for part in parts)
    if total <= budget:
        return list(parts)
    weights = [SHAPE_WEIGHT if part.material in SHAPE_MATERIALS else 1.0 for part in parts]
    shares = [weight * len(part.triangles) for weight, part in zip(weights, parts, strict=True)]
    return [
        replace(
            _simplify_part(part, max(MIN_PART_TRIANGLES, int(budget * share / sum(shares)))),
            wheel=part.wheel,
        )
        for part, share in zip(parts, shares, strict=True)
    ]


def _simplify_part(part: ModelPart, count: int) -> ModelPart:
    if len(part.triangles) <= count:
        return part
    points, triangles = cast(
        tuple[NDArray[np.float64], NDArray[np.int32]],
        fast_simplification.simplify(
            part.vertices, part.triangles.astype(np.int32), target_count=count, agg=3
        ),
    )
    return _weld_parts(
        part.material, [ModelPart(part.material, points, triangles.astype(np.int64))]
    )

"""Converts foreign models: to the body frame, metres, materials of the table, and few triangles.

Parts invisible from outside are dropped, and triangles are wound towards the viewer. Materials
are classified by declaration, name, colour and position.
"""

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import cast

import fast_simplification
import numpy as np
from advercity_dsl.catalogue import BodyModel, MaterialPart
from numpy.typing import NDArray

from advercity.assets.model_files import ModelPart
from advercity.assets.model_images import ModelImage, project_images
from advercity.assets.model_wheels import separate_wheels
from advercity.assets.people.package import PEOPLE
from advercity.errors import RunError
from advercity.geometry.arrays import Float64Array
from advercity.geometry.directions import spread_directions
from advercity.geometry.mesh import Size
from advercity.materials import ACTOR_PAINT

CONVERSION_VERSION = 3
"""Part of the key of converted files; raise it when conversion changes."""
PROPORTION_TOLERANCE = 0.25
"""Deviation of a model's proportions from its blueprint's at which it is taken as rotated."""
SNAP_DECIMALS = 6
"""Decimals of metres in rounded vertices."""
WELD_FRACTION = 5e-5
"""Distance at which vertices are merged, as a fraction of the part's size."""
SHAPE_MATERIALS = frozenset({ACTOR_PAINT, "glass", "lamp_white", "lamp_red"})
"""Materials of a vehicle's recognisable parts, which keep more triangles."""
SHAPE_WEIGHT = 3.0
BODY_MIN_ELEVATION_SINE, WHEEL_MIN_ELEVATION_SINE = -0.25, -1.0
"""Lowest elevation of viewers: undersides of bodies are hidden, but wheels turn."""
MIN_PART_TRIANGLES = 24
"""Least number of triangles of a part."""
SKY_DIRECTION_COUNT = 64
SAMPLE_BARYCENTRICS = np.array([(1, 1, 1), (4, 1, 1), (1, 4, 1), (1, 1, 4)]) / np.array(
    [[3], [6], [6], [6]]
)
"""Barycentric coordinates of the points on a triangle from which rays to the sky start."""
RAY_OFFSET_M = 2e-3
LENS_PARTS = frozenset({"glass", "headlamp", "tail_lamp"})
"""Parts classified again by their position on the body."""
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
"""Key of MATERIALS of every kept part."""

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


def convert_model(parts: Iterable[ModelPart], model: BodyModel, size: Size) -> list[ModelPart]:
    """Convert a model into its visible parts, one for each material and wheel.

    Parts are as in the file; the model declares their orientation and materials, and the number of
    triangles. They are scaled to the blueprint's `size`.

    Raises:
        RunError: No part is left, or the proportions differ from the blueprint's.
    """
    rest, wheels = _separate(parts, model, size)
    visible = _keep_visible(_group_by_material(rest, model, size), BODY_MIN_ELEVATION_SINE)
    for number, wheel in enumerate(wheels, start=1):
        turning = _keep_visible(_group_by_material(wheel, model, size), WHEEL_MIN_ELEVATION_SINE)
        visible += [replace(part, wheel=number) for part in turning]
    return _simplify_parts(visible, model.triangles)


def project_model_images(
    parts: Iterable[ModelPart], converted: Sequence[ModelPart], model: BodyModel, size: Size
) -> list[ModelImage]:
    """Find the images of a model on the parts made by `convert_model`."""
    rest, wheels = _separate(parts, model, size)
    sources = [
        replace(
            part,
            material=MATERIAL_BY_PART[kind],
            triangles=part.triangles[kinds == kind],
            uv=None if part.uv is None else part.uv[kinds == kind],
            wheel=number,
        )
        for number, pieces in enumerate([rest, *wheels])
        for part in pieces
        for kinds in [_classify_triangles(part, model, size)]
        for kind in np.unique(kinds)
    ]
    return project_images(converted, sources)


def _separate(
    parts: Iterable[ModelPart], model: BodyModel, size: Size
) -> tuple[list[ModelPart], list[list[ModelPart]]]:
    """Bring a model into the body frame: its body and its wheels."""
    kept = [part for part in parts if classify_material(part.material, model.materials) != "none"]
    if not kept:
        raise RunError(f"{format_model_name(model)}: none of its materials maps to a part")
    upright = [_turn_upright(part, model) for part in kept]
    rest, wheels = separate_wheels(_scale_to_size(upright, model, size))
    return _snap_parts(rest), [_snap_parts(wheel) for wheel in wheels]


def _snap_parts(parts: Iterable[ModelPart]) -> list[ModelPart]:
    """Round vertices, since the last bits of rotations and of fits differ between processors."""
    return [replace(part, vertices=np.round(part.vertices, SNAP_DECIMALS)) for part in parts]


def format_model_name(model: BodyModel) -> str:
    """Return the name of a model for messages."""
    return model.pack or model.file or f"people of {PEOPLE.name}"


def _turn_upright(part: ModelPart, model: BodyModel) -> ModelPart:
    x, y, z = part.vertices.T
    if model.up == "y":
        x, y, z = z, x, y
    turn = np.radians(model.turn_deg)
    cosine, sine = np.cos(turn), np.sin(turn)
    vertices = np.column_stack([x * cosine - y * sine, x * sine + y * cosine, z])
    return replace(part, vertices=vertices)


def _scale_to_size(parts: Sequence[ModelPart], model: BodyModel, size: Size) -> list[ModelPart]:
    """Scale the parts to the size, their base centred on the origin."""
    used = np.concatenate([part.vertices[part.triangles].reshape(-1, 3) for part in parts])
    low, high = used.min(axis=0), used.max(axis=0)
    factor = np.asarray(size) / np.maximum(high - low, 1e-9)
    # Units of models are unknown, so only the ratio of the three factors can be checked.
    stretch = factor / np.median(factor)
    if np.abs(stretch - 1.0).max() > PROPORTION_TOLERANCE:
        extent = " x ".join(f"{length:.3g}" for length in high - low)
        raise RunError(
            f"{format_model_name(model)}: is {extent} (length, width, height in its own unit),"
            f" which does not fit {size[0]:g} x {size[1]:g} x {size[2]:g} m; set `turn_deg`"
            " and `up` so that its front faces along x and its roof up"
        )
    middle = (low + high) / 2 * (1, 1, 0) + low * (0, 0, 1)
    return [replace(part, vertices=(part.vertices - middle) * factor) for part in parts]


def _group_by_material(parts: Sequence[ModelPart], model: BodyModel, size: Size) -> list[ModelPart]:
    groups: dict[str, list[ModelPart]] = {}
    for part in parts:
        kinds = _classify_triangles(part, model, size)
        for kind in np.unique(kinds):
            material = MATERIAL_BY_PART[kind]
            triangles = part.triangles[kinds == kind]
            groups.setdefault(material, []).append(ModelPart(material, part.vertices, triangles))
    return [_weld_parts(material, group) for material, group in sorted(groups.items())]


def _classify_triangles(part: ModelPart, model: BodyModel, size: Size) -> NDArray[np.str_]:
    """Classify the triangles (m,) of a part in the body frame."""
    kind = classify_material(part.material, model.materials)
    kinds = (
        classify_triangles_by_colour(part)
        if kind == "by_colour"
        else np.full(len(part.triangles), kind)
    )
    if kind in LENS_PARTS or kind == "by_colour":
        return correct_parts_by_position(kinds, part, size)
    return kinds


def _weld_parts(material: str, parts: Sequence[ModelPart]) -> ModelPart:
    corners = np.concatenate([part.vertices[part.triangles] for part in parts]).reshape(-1, 3)
    cell = WELD_FRACTION * np.ptp(corners, axis=0).max() + 1e-6
    grid = np.round(corners / cell).astype(np.int64)
    _, first, index = np.unique(grid, axis=0, return_index=True, return_inverse=True)
    triangles = index.reshape(-1, 3)
    a, b, c = triangles.T
    return ModelPart(material, corners[first], triangles[(a != b) & (b != c) & (c != a)])


def _keep_visible(parts: Sequence[ModelPart], min_elevation_sine: float) -> list[ModelPart]:
    """Keep the visible triangles, wound towards the viewer; sheets seen from both sides double."""
    starts = np.cumsum([0, *(len(part.vertices) for part in parts)])
    vertices = np.concatenate([part.vertices for part in parts])
    pairs = zip(parts, starts, strict=False)
    triangles = np.concatenate([part.triangles + start for part, start in pairs])
    front, back = find_visible_sides(vertices, triangles, min_elevation_sine)
    bounds = np.cumsum([0, *(len(part.triangles) for part in parts)])
    kept: list[ModelPart] = []
    for part, first, last in zip(parts, bounds[:-1], bounds[1:], strict=True):
        faces = np.concatenate(
            [part.triangles[front[first:last]], part.triangles[back[first:last]][:, ::-1]]
        )
        if len(faces):
            kept.append(_weld_parts(part.material, [replace(part, triangles=faces)]))
    return kept


def _simplify_parts(parts: Sequence[ModelPart], budget: int) -> list[ModelPart]:
    """Simplify the parts to about `budget` triangles; parts of the shape keep more."""
    total = sum(len(part.triangles) for part in parts)
    if total <= budget:
        return list(parts)
    weights = [SHAPE_WEIGHT if part.material in SHAPE_MATERIALS else 1.0 for part in parts]
    counts = [weight * len(part.triangles) for weight, part in zip(weights, parts, strict=True)]
    return [
        _simplify_part(part, max(MIN_PART_TRIANGLES, int(budget * count / sum(counts))))
        for part, count in zip(parts, counts, strict=True)
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
    simple = ModelPart(part.material, points, triangles.astype(np.int64))
    return replace(_weld_parts(part.material, [simple]), wheel=part.wheel)


def classify_material(name: str, declared: Mapping[str, MaterialPart]) -> MaterialPart:
    """Classify a material: as declared, else by its name, else as plastic."""
    if name in declared:
        return declared[name]
    for pattern, part in _PART_PATTERNS:
        if re.search(pattern, name.lower()):
            return part
    return "plastic"


def classify_triangles_by_colour(part: ModelPart) -> NDArray[np.str_]:
    """Classify the triangles (m,) of a part by the colour of its texture.

    Such parts have lamps, plates, trim and the rims of wheels, but no bodywork and no windows.
    """
    if part.colours is None:
        return np.full(len(part.triangles), "plastic")
    red, green, blue = part.colours.T
    is_red = (red > 0.3) & (red > 1.8 * green) & (red > 1.8 * blue)
    is_amber = (red > 0.5) & (green > 0.25) & (blue < 0.45 * red) & ~is_red
    is_light = part.colours.mean(axis=1) > 0.45
    normal = _compute_normals(part.vertices, part.triangles)
    # Of light parts only rims face sideways.
    is_rim = np.abs(normal[:, 1]) > 0.85 * np.linalg.norm(normal, axis=1)
    is_ahead = part.vertices[part.triangles][:, :, 0].mean(axis=1) > 0.0
    is_lamp = is_light & ~is_rim & is_ahead
    kinds = [is_red & ~is_rim, is_amber, is_lamp, part.colours.mean(axis=1) > 0.3]
    return np.select(kinds, ["tail_lamp", "indicator", "headlamp", "metal"], "plastic")


def correct_parts_by_position(
    kinds: NDArray[np.str_], part: ModelPart, size: Size
) -> NDArray[np.str_]:
    """Reclassify triangles (m,) by their position on a body of a size.

    Headlamps are in front and at the sides, tail lamps behind, lamp covers low at either end.
    """
    middle = part.vertices[part.triangles].mean(axis=1)
    along = middle[:, 0] / size[0]
    _, across, height = (np.abs(middle) / np.maximum(size, 1e-9)).T
    is_cover = (kinds == "glass") & (np.abs(along) > 0.36) & (height < 0.5)
    lamp = np.where(along > 0.0, "headlamp", "tail_lamp")
    placed = np.where(is_cover | (kinds == "headlamp"), lamp, kinds)
    is_white = (placed == "headlamp") & (along > 0.2) & (across > 0.18) & (height < 0.65)
    is_red = (placed == "tail_lamp") & (along < -0.2)
    placed = np.where((placed == "headlamp") & ~is_white, "metal", placed)
    return np.where((placed == "tail_lamp") & ~is_red, "plastic", placed)


def find_visible_sides(
    vertices: Float64Array, triangles: NDArray[np.int64], min_elevation_sine: float
) -> tuple[NDArray[np.bool_], ...]:
    """Find the visible front and back sides (m,) of triangles by casting rays to the sky.

    A side is visible if a ray from one of its sample points meets nothing. Vertices are (n, 3) with
    z up, triangles (m, 3); `min_elevation_sine` is of the lowest elevation of viewers.
    """
    # trimesh takes a while to load, and only conversion needs it here.
    import trimesh
    from trimesh.ray.ray_pyembree import RayMeshIntersector

    world = RayMeshIntersector(trimesh.Trimesh(vertices, triangles, process=False))
    corners = vertices[triangles]
    normal = _compute_normals(vertices, triangles)
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-12)
    directions = spread_directions(SKY_DIRECTION_COUNT, min_sine=min_elevation_sine)
    sides = []
    for sign in (1.0, -1.0):
        free = np.zeros(len(triangles), dtype=bool)
        for place in SAMPLE_BARYCENTRICS:
            start = _sum_products(corners, place[:, None]) + sign * RAY_OFFSET_M * normal
            for direction in np.round(directions, SNAP_DECIMALS):
                rows = np.flatnonzero(~free & (sign * _sum_products(normal, direction) > 0.05))
                if len(rows):
                    rays = np.broadcast_to(direction, (len(rows), 3))
                    free[rows] = ~world.intersects_any(start[rows], rays)
        sides.append(free)
    return tuple(sides)


def _sum_products(values: Float64Array, weights: Float64Array) -> Float64Array:
    """Sum three weighted columns (n, 3, ...) in one order: BLAS has one for each processor."""
    first, second, third = (values[:, column] * weights[column] for column in range(3))
    return first + second + third


def _compute_normals(vertices: Float64Array, triangles: NDArray[np.int64]) -> Float64Array:
    """Compute normals (m, 3) of triangles, twice as long as their areas."""
    a, b, c = (vertices[triangles[:, corner]] for corner in range(3))
    return np.cross(b - a, c - a)

"""From a blueprint to its body."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
from advercity_dsl import ActorClass, Blueprint, LampPositions

from advercity.assets.cars import build_car, build_van
from advercity.assets.model_files import read_glb
from advercity.assets.model_store import ModelStore
from advercity.assets.model_wheels import find_model_wheels
from advercity.assets.pedestrians import build_pedestrian, draw_looks
from advercity.assets.rigged_bodies import fit_to_box
from advercity.assets.trucks import build_truck
from advercity.assets.two_wheelers import build_bicycle, build_model_rider, build_motorcycle
from advercity.assets.vehicle_parts import add_indicators
from advercity.geometry.mesh import (
    Mesh,
    MeshPart,
    Size,
    TriangleSurface,
    add_mirror_image,
    build_meshes,
)
from advercity.geometry.primitives import ellipsoid
from advercity.semantics import Semantic
from advercity.world import Body

_LENS_MATERIALS = {
    "low_beam": "lamp_white",
    "rear": "lamp_red",
    "front_fog": "lamp_white",
    "rear_fog": "lamp_red",
    "front_indicator": "lamp_amber",
    "rear_indicator": "lamp_amber",
}
_LENS_RADII_M = (0.05, 0.12, 0.08)
_BUILDERS: dict[ActorClass, Callable[[str, Size], list[MeshPart]]] = {
    "car": build_car,
    "van": build_van,
    "truck": build_truck,
}
_RIDDEN_BUILDERS: dict[ActorClass, Callable[[str, Size], Body]] = {
    "bicycle": build_bicycle,
    "motorcycle": build_motorcycle,
}


def build_body(
    blueprint_id: str, blueprint: Blueprint, model_store: ModelStore | None = None
) -> Body:
    """The body of a blueprint; the same blueprint and shelf always give the same bytes.

    It fills its box exactly. The part of material `paint` takes the actor's own paint.

    Args:
        blueprint_id: Name of the blueprint, by which bodies of one shape differ a little.
        blueprint: What it is.
        model_store: Where its model may lie; without one, or without the model, it is shaped here.

    Raises:
        RunError: Its model is there but cannot be used.
    """
    made = _build_fitted_body(blueprint_id, blueprint, model_store)
    if blueprint.actor_class in ("pedestrian", "bicycle"):
        return made
    parts = [_clip_to_box(part, made.size) for part in add_indicators(made.parts)]
    return replace(made, parts=tuple(parts))


def _clip_to_box(part: Mesh, size: Size) -> Mesh:
    """The part flattened where it would stand out of the box, as added lamps may on a model."""
    low = np.multiply(size, (-0.5, -0.5, 0.0)).astype(np.float32)
    high = np.multiply(size, (0.5, 0.5, 1.0)).astype(np.float32)
    return replace(part, vertices=np.clip(part.vertices, low, high))


def _build_fitted_body(blueprint_id: str, blueprint: Blueprint, shelf: ModelStore | None) -> Body:
    size = (blueprint.length_m, blueprint.width_m, blueprint.height_m)
    model = None if shelf is None else shelf.prepare_model(blueprint)
    if model is not None:
        pieces = [
            *_load_model_pieces(model, blueprint.actor_class),
            *_build_lenses(blueprint.lamps),
        ]
        if blueprint.model and blueprint.model.ridden:
            pieces += build_model_rider(blueprint_id, blueprint.model.ridden, size)
    elif blueprint.actor_class == "pedestrian":
        return build_pedestrian(blueprint.looks or draw_looks(blueprint_id, size[2]), size)
    elif blueprint.actor_class in _RIDDEN_BUILDERS:
        return fit_to_box(_RIDDEN_BUILDERS[blueprint.actor_class](blueprint_id, size), size)
    else:
        pieces = _BUILDERS[blueprint.actor_class](blueprint_id, size)
    return fit_to_box(Body(tuple(build_meshes(pieces)), size), size)


def _load_model_pieces(path: Path, actor_class: ActorClass) -> list[MeshPart]:
    """Pieces of a converted model."""
    semantic = Semantic.PEDESTRIAN if actor_class == "pedestrian" else Semantic.VEHICLE
    parts = read_glb(path.read_bytes(), path.name)
    wheels = find_model_wheels(parts, has_steering=actor_class != "motorcycle")
    return [
        MeshPart(
            TriangleSurface(part.vertices, part.triangles),
            part.material,
            semantic,
            wheels.get(part.wheel),
        )
        for part in parts
    ]


def _build_lenses(lamps: LampPositions) -> list[MeshPart]:
    """Glasses of the lamps whose places a blueprint gives, for models that have none there."""
    pieces: list[MeshPart] = []
    for name, material in _LENS_MATERIALS.items():
        place = getattr(lamps, name)
        if place is not None:
            glass = ellipsoid(place, _LENS_RADII_M, sides=10, bands=6)
            both = add_mirror_image(glass) if place[1] else glass
            pieces.append(MeshPart(both, material, Semantic.VEHICLE))
    return pieces

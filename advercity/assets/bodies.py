"""Builds the body of a blueprint: an installed model, or a procedural shape of the same size."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
from advercity_dsl import ActorClass, Blueprint, LampPositions

from advercity.assets.cabins import build_model_cabin
from advercity.assets.cargo_boxes import build_model_cargo_trim
from advercity.assets.cars import build_car, build_van
from advercity.assets.lorries import build_tractor
from advercity.assets.model_conversion import format_model_name
from advercity.assets.model_files import read_glb
from advercity.assets.model_images import find_images_file, name_image, read_images
from advercity.assets.model_store import ModelStore
from advercity.assets.model_wheels import find_model_wheels
from advercity.assets.pedestrians import build_pedestrian, build_people, draw_looks
from advercity.assets.people.storage import read_people
from advercity.assets.rigged_bodies import fit_to_box
from advercity.assets.semitrailers import build_semitrailers
from advercity.assets.trucks import build_truck
from advercity.assets.two_wheelers import build_bicycle, build_model_rider, build_motorcycle
from advercity.assets.vehicle_parts import add_indicators, make_vehicle_parts
from advercity.errors import RunError
from advercity.geometry.arrays import Float32Array
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
"""Materials of lenses by fields of `LampPositions`."""
_LENS_RADII_M = (0.05, 0.12, 0.08)
_PART_BUILDERS: dict[ActorClass, Callable[[str, Size], list[MeshPart]]] = {
    "car": build_car,
    "van": build_van,
    "truck": build_truck,
}
_BODY_BUILDERS: dict[ActorClass, Callable[[str, Size], Body]] = {
    "bicycle": build_bicycle,
    "motorcycle": build_motorcycle,
}


def build_body(
    blueprint_id: str, blueprint: Blueprint, model_store: ModelStore | None = None
) -> Body:
    """Build the body of a blueprint; the same blueprint and models give the same bytes.

    It fills its box exactly. Parts of material `paint` take the paint of their actor.

    Args:
        blueprint_id: Name of the blueprint; procedural bodies of one shape differ by it a little.
        blueprint: Class, size, model and looks.
        model_store: Where its model is; without a store the body is procedural.

    Raises:
        RunError: Its model is not installed, or cannot be used.
    """
    body = _build_fitted_body(blueprint_id, blueprint, model_store)
    if blueprint.actor_class in ("pedestrian", "bicycle"):
        return body
    first, *others = map(_add_indicators, (body, *body.others))
    return replace(first, others=tuple(others))


def _add_indicators(body: Body) -> Body:
    parts = [_clip_to_box(part, body.size) for part in add_indicators(body.parts)]
    return replace(body, parts=tuple(parts))


def _clip_to_box(part: Mesh, size: Size) -> Mesh:
    """Flatten a part where it extends beyond the box, as added lenses may on a model."""
    low = np.multiply(size, (-0.5, -0.5, 0.0)).astype(np.float32)
    high = np.multiply(size, (0.5, 0.5, 1.0)).astype(np.float32)
    return replace(part, vertices=np.clip(part.vertices, low, high))


def _build_fitted_body(blueprint_id: str, blueprint: Blueprint, store: ModelStore | None) -> Body:
    size, actor_class = blueprint.size, blueprint.actor_class
    model = blueprint.model
    if model is not None and store is not None:
        path = store.prepare_model(blueprint)
        if path is None:
            raise RunError(f"the model {format_model_name(model)} is not installed")
        if model.person is not None:
            return build_people(read_people(path), blueprint)
        parts = [*_load_model_parts(path, actor_class), *_build_lenses(blueprint.lamps)]
        if actor_class == "truck":
            parts += build_model_cargo_trim(blueprint_id, parts)
        if actor_class in _PART_BUILDERS:
            parts += build_model_cabin(blueprint_id, parts, is_truck=actor_class == "truck")
        if model.ridden:
            parts += build_model_rider(blueprint_id, model.ridden, size)
    elif actor_class == "pedestrian":
        # Its box holds a whole stride, so its builder fits it while it solves for the stride.
        looks = blueprint.looks or draw_looks(blueprint_id, size[2])
        return build_pedestrian(looks, blueprint)
    elif actor_class in _BODY_BUILDERS:
        return fit_to_box(_BODY_BUILDERS[actor_class](blueprint_id, size), size)
    elif blueprint.tows:
        parts = build_tractor(blueprint_id, size, blueprint.tows)
    elif blueprint.semitrailer:
        first, *others = (
            fit_to_box(Body(tuple(build_meshes(parts)), size), size)
            for parts in build_semitrailers(blueprint_id, size, blueprint.semitrailer)
        )
        return replace(first, others=tuple(others))
    else:
        parts = _PART_BUILDERS[actor_class](blueprint_id, size)
    return fit_to_box(Body(tuple(build_meshes(parts)), size), size)


def _load_model_parts(path: Path, actor_class: ActorClass) -> list[MeshPart]:
    semantic = Semantic.PEDESTRIAN if actor_class == "pedestrian" else Semantic.VEHICLE
    parts = read_glb(path.read_bytes(), path.name)
    wheels = find_model_wheels(parts, has_steering=actor_class != "motorcycle")
    file = find_images_file(path)
    placed = {
        part: (uv, name_image(file, number))
        for number, image in enumerate(read_images(file))
        for part, uv in image.uv.items()
    }
    pieces: list[MeshPart] = []
    for number, part in enumerate(parts):
        surface, maps = TriangleSurface(part.vertices, part.triangles), ""
        if number in placed:
            uv, maps = placed[number]
            surface = _place_image(surface, uv)
        wheel = wheels.get(part.wheel)
        pieces.append(MeshPart(surface, part.material, semantic, wheel, maps=maps))
    return pieces


def _place_image(surface: TriangleSurface, uv: Float32Array) -> TriangleSurface:
    """Give every triangle (m,) corners of its own, with their coordinates (m, 3, 2)."""
    corners = surface.vertices[surface.triangles].reshape(-1, 3)
    triangles = np.arange(len(corners)).reshape(-1, 3)
    return TriangleSurface(corners, triangles, uv=uv.reshape(-1, 2).astype(np.float64))


def _build_lenses(lamps: LampPositions) -> list[MeshPart]:
    """Build lenses at the lamp positions of a blueprint, for models without glass there."""
    parts: list[MeshPart] = []
    for name, material in _LENS_MATERIALS.items():
        position = getattr(lamps, name)
        if position is not None:
            lens = ellipsoid(position, _LENS_RADII_M, sides=10, bands=6)
            # A lamp on the centre line is one; others are declared on the left and come in pairs.
            pair = add_mirror_image(lens) if position[1] else lens
            parts += make_vehicle_parts(material, pair)
    return parts

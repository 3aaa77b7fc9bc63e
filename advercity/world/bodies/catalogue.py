"""From a blueprint to its body."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
from advercity_dsl import ActorClass, Blueprint, LampPlaces

from advercity.semantics import Semantic
from advercity.world.assets import Shelf
from advercity.world.assets.glb import read_glb
from advercity.world.bodies.bicycles import bicycle
from advercity.world.bodies.cars import car, van
from advercity.world.bodies.indicators import with_indicators
from advercity.world.bodies.motorcycles import motorcycle, rider_of
from advercity.world.bodies.people import drawn_looks, pedestrian
from advercity.world.bodies.puppets import fitted
from advercity.world.bodies.trucks import truck
from advercity.world.bodies.wheels import wheels_of
from advercity.world.scene import Body, Mesh
from advercity.world.shapes import Piece, Surface, both_sides, ellipsoid, meshes

Size = tuple[float, float, float]
_LENSES = {
    "low_beam": "lamp_white",
    "rear": "lamp_red",
    "front_fog": "lamp_white",
    "rear_fog": "lamp_red",
    "front_indicator": "lamp_amber",
    "rear_indicator": "lamp_amber",
}
_LENS_RADII_M = (0.05, 0.12, 0.08)
_BUILDERS: dict[ActorClass, Callable[[str, Size], list[Piece]]] = {
    "car": car,
    "van": van,
    "truck": truck,
}
_RIDDEN: dict[ActorClass, Callable[[str, Size], Body]] = {
    "bicycle": bicycle,
    "motorcycle": motorcycle,
}


def body(blueprint_id: str, blueprint: Blueprint, shelf: Shelf | None = None) -> Body:
    """The body of a blueprint; the same blueprint and shelf always give the same bytes.

    It fills its box exactly. The part of material `paint` takes the actor's own paint.

    Args:
        blueprint_id: Name of the blueprint, by which bodies of one shape differ a little.
        blueprint: What it is.
        shelf: Where its model may lie; without one, or without the model, it is shaped here.

    Raises:
        RunError: Its model is there but cannot be used.
    """
    made = _made(blueprint_id, blueprint, shelf)
    if blueprint.actor_class in ("pedestrian", "bicycle"):
        return made
    parts = [_within(part, made.size) for part in with_indicators(made.parts)]
    return replace(made, parts=tuple(parts))


def _within(part: Mesh, size: Size) -> Mesh:
    """The part flattened where it would stand out of the box, as added lamps may on a model."""
    low = np.multiply(size, (-0.5, -0.5, 0.0)).astype(np.float32)
    high = np.multiply(size, (0.5, 0.5, 1.0)).astype(np.float32)
    return replace(part, vertices=np.clip(part.vertices, low, high))


def _made(blueprint_id: str, blueprint: Blueprint, shelf: Shelf | None) -> Body:
    size = (blueprint.length_m, blueprint.width_m, blueprint.height_m)
    model = None if shelf is None else shelf.find(blueprint)
    if model is not None:
        pieces = [*_modelled(model, blueprint.actor_class), *_lenses(blueprint.lamps)]
        if blueprint.model and blueprint.model.ridden:
            pieces += rider_of(blueprint_id, blueprint.model.ridden, size)
    elif blueprint.actor_class == "pedestrian":
        return pedestrian(blueprint.looks or drawn_looks(blueprint_id, size[2]), size)
    elif blueprint.actor_class in _RIDDEN:
        return fitted(_RIDDEN[blueprint.actor_class](blueprint_id, size), size)
    else:
        pieces = _BUILDERS[blueprint.actor_class](blueprint_id, size)
    return fitted(Body(tuple(meshes(pieces)), size), size)


def _modelled(path: Path, actor_class: ActorClass) -> list[Piece]:
    """Pieces of a converted model."""
    semantic = Semantic.PEDESTRIAN if actor_class == "pedestrian" else Semantic.VEHICLE
    parts = read_glb(path.read_bytes(), path.name)
    wheels = wheels_of(parts, steer=actor_class != "motorcycle")
    return [
        Piece(
            Surface(part.vertices, part.triangles), part.material, semantic, wheels.get(part.wheel)
        )
        for part in parts
    ]


def _lenses(lamps: LampPlaces) -> list[Piece]:
    """Glasses of the lamps whose places a blueprint gives, for models that have none there."""
    pieces: list[Piece] = []
    for name, material in _LENSES.items():
        place = getattr(lamps, name)
        if place is not None:
            glass = ellipsoid(place, _LENS_RADII_M, sides=10, bands=6)
            both = both_sides(glass) if place[1] else glass
            pieces.append(Piece(both, material, Semantic.VEHICLE))
    return pieces

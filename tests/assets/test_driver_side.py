"""Drivers of left-hand traffic sit on the right; nothing else of a vehicle changes sides."""

from pathlib import Path

import pytest
from advercity_dsl import Spec

from advercity.assets.bodies import build_body
from advercity.assets.driver_side import seat_driver_on_right
from advercity.geometry.mesh import MeshLayer
from advercity.pipeline.preparation import load_or_build_world
from advercity.world import Body
from tests.roads.left_hand_roads import build_street
from tests.shipped import CATALOGUE


def find_driver_y(body: Body) -> list[float]:
    drivers = [part for part in body.parts if part.layer is MeshLayer.OCCUPANT]
    return [float(part.vertices[:, 1].mean()) for part in drivers]


@pytest.mark.parametrize("name", ["seat_leon", "toyota_prius"])
def test_the_driver_and_the_wheel_change_sides(name: str) -> None:
    body = build_body(name, CATALOGUE.blueprints[name])

    moved = seat_driver_on_right(body)

    assert min(find_driver_y(body)) > 0.2
    assert find_driver_y(moved) == pytest.approx([-y for y in find_driver_y(body)])
    assert moved.size == body.size
    letters = 0
    for part, before in zip(moved.parts, body.parts, strict=True):
        if before.layer is MeshLayer.SHAPE:
            assert part is before
        for first, last in before.writing:
            # Plates are in the middle: letters stay where they are, and in their order.
            letters += 1
            ahead, then = part.vertices[first:last], before.vertices[first:last]
            assert ahead == pytest.approx(then, abs=0.03)
    assert letters == 2


def test_a_body_without_a_cabin_of_ours_stays_as_it_is() -> None:
    name = next(
        name for name, item in CATALOGUE.blueprints.items() if item.actor_class == "bicycle"
    )
    body = build_body(name, CATALOGUE.blueprints[name])

    assert seat_driver_on_right(body) is body


def test_vehicles_of_a_left_hand_road_have_them_on_the_right(specs: dict[str, Spec]) -> None:
    spec = specs["ui_clear_day_sparse"]
    changes = {
        "road": build_street(surroundings=()),
        "blueprints": {
            "seat_leon": CATALOGUE.blueprints["seat_leon"].model_copy(update={"model": None})
        },
        "assets": {},
    }

    world = load_or_build_world(spec.model_copy(update=changes), Path("road.net.xml"))

    assert max(find_driver_y(world.bodies["seat_leon"])) < -0.2

"""Wheels of simulated vehicles touch the road mesh, and people walk on the ground."""

from dataclasses import replace

import numpy as np
import pytest
from advercity_dsl import Spec

from advercity.frames import ActorState, Trace
from advercity.pipeline.preparation import load_or_simulate_traffic
from advercity.rendering.raycaster import Raycaster, Rays
from advercity.scene.build import build_world
from advercity.semantics import Semantic
from advercity.world import World

pytestmark = pytest.mark.sumo
LIFT_M = 1.0
SEMITRAILER_AXLES_M = -2.5
"""Its axles are 7.7 m behind the kingpin, which is 5.2 m before its middle."""
EVERY = 24


@pytest.fixture(scope="module")
def hills(specs: dict[str, Spec]) -> tuple[World, Trace]:
    """The road with the steepest grades, and traffic on it."""
    spec = specs["rcnj_clear_day_sparse"]
    traffic = load_or_simulate_traffic(spec)
    return build_world(spec, traffic.network_path), traffic.trace


def wheels(state: ActorState) -> np.ndarray:
    """Contact points (n, 3) of the wheels of a vehicle, in the world."""
    length, width, _ = state.actor.size
    sides = (0.0,) if state.actor.actor_class in ("bicycle", "motorcycle") else (-0.4, 0.4)
    axles_m = [SEMITRAILER_AXLES_M] if state.actor.towed_by else [-0.3 * length, 0.3 * length]
    places = [(axle_m, side * width, 0, 1) for axle_m in axles_m for side in sides]
    return (np.array(places) @ state.world_from_body.T)[:, :3]


def test_wheels_touch_the_road_on_grades_too(hills: tuple[World, Trace]):
    world, trace = hills
    caster = Raycaster(world)
    gaps: list[float] = []
    surfaces: list[int] = []
    steepest = 0.0
    for index in range(0, len(trace), EVERY):
        frame = trace.build_frame(index)
        caster.place(replace(frame, states=()))
        places = np.concatenate([wheels(state) for state in frame.states])
        down = np.tile(np.array([0, 0, -1], np.float32), (len(places), 1))
        above = np.add(places, [0, 0, LIFT_M]).astype(np.float32)
        hits = caster.cast(Rays(above, down), 2 * LIFT_M)
        gaps += (hits.range_m - LIFT_M).tolist()
        surfaces += hits.semantic.tolist()
        steepest = max(steepest, *(abs(state.world_from_body[2, 0]) for state in frame.states))
    assert steepest > 0.07
    is_paved = np.isin(surfaces, (Semantic.ROAD, Semantic.ROAD_LINE))
    assert np.abs(gaps)[is_paved].max() < 0.02
    # In narrow bends wheels of a semi-trailer come to the verge, whose height nothing follows.
    assert np.mean(is_paved) > 0.99
    assert np.abs(gaps).max() < 0.05


def test_people_walk_on_the_ground_on_streets_too(specs: dict[str, Spec]):
    spec = specs["unj_clear_day_sparse"]
    traffic = load_or_simulate_traffic(spec)
    caster = Raycaster(build_world(spec, traffic.network_path))
    semantic: list[int] = []
    gaps: list[float] = []
    for index in range(0, len(traffic.trace), EVERY):
        frame = traffic.trace.build_frame(index)
        people = [one for one in frame.states if one.actor.actor_class == "pedestrian"]
        feet = np.array([one.world_from_body[:3, 3] for one in people])
        down = np.tile(np.array([0, 0, -1], np.float32), (len(feet), 1))
        above = np.add(feet, [0, 0, LIFT_M]).astype(np.float32)
        hits = caster.cast(Rays(above, down), 2 * LIFT_M)
        gaps += (hits.range_m - LIFT_M).tolist()
        semantic += hits.semantic.tolist()
    on_street = np.isin(semantic, (Semantic.ROAD, Semantic.ROAD_LINE))
    assert on_street.sum() >= 3
    # They need a step to climb a kerb of 0.15 m, next to which the roadway slopes a little.
    assert np.abs(gaps).max() < 0.16
    assert np.median(np.abs(np.array(gaps)[on_street])) < 0.02

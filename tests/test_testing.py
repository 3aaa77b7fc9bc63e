"""What ships for tests of one's own is itself in order."""

import numpy as np

from advercity.rendering.backend import Backend
from advercity.rendering.raycaster import Raycaster, Rays
from advercity.semantics import Semantic
from advercity.testing import (
    BackendContract,
    FakeBackend,
    build_box,
    build_flat_world,
    load_example_spec,
    make_actor_state,
    make_frame,
    with_small_sensors,
)


class TestFakeBackend(BackendContract):
    def make_backend(self) -> Backend:
        return FakeBackend()


def test_a_flat_world_has_ground_at_zero_and_what_is_put_on_it() -> None:
    world = build_flat_world(build_box((1.0, 40.0, 10.0), (20.5, 0.0, 5.0)))
    caster = Raycaster(world)
    caster.place(make_frame(make_actor_state(7, 10.0)))
    origins = np.array([[0, 0, 5], [0, 0, 5], [0, 0, 1]], np.float32)
    directions = np.array([[0, 0, -1], [1, 0, 0], [1, 0, 0]], np.float32)
    hits = caster.cast(Rays(origins, directions), 100.0)
    np.testing.assert_allclose(hits.range_m, [5.0, 20.0, 8.0], rtol=1e-6)
    assert hits.semantic.tolist() == [Semantic.ROAD, Semantic.BUILDING, Semantic.VEHICLE]
    assert hits.instance.tolist() == [0, 0, 7]


def test_a_spec_with_small_sensors_is_otherwise_the_same() -> None:
    spec = load_example_spec("ri_fog_day_sparse")
    small = with_small_sensors(spec, width_px=24, height_px=16, channels=2, azimuths=32)
    for agent in small.agents:
        assert (
            agent.sensors.cameras[0].model.width_px,
            agent.sensors.cameras[0].model.height_px,
        ) == (24, 16)
        assert (agent.sensors.lidars[0].channels, agent.sensors.lidars[0].azimuths) == (2, 32)
    assert small.road == spec.road
    assert small.weather == spec.weather

"""Whether the ego can stop within its sight."""

import pytest
from advercity_dsl import Spec

from advercity.physics.stopping import compute_stopping_distance
from advercity.pipeline.descriptions import describe_spec


@pytest.mark.parametrize(
    ("mor_m", "told"),
    [
        # 35 km/h are 9.72 m/s: 14.58 m to react, 94.52 / (2 x 0.785 x 9.81) = 6.14 m to brake.
        (75, "21 m from 35 km/h, with 1.5 s to react and a friction of 0.79; visibility 75 m: the"
         " ego can stop in sight"),
        (15, "visibility 15 m: the ego cannot stop in sight"),
    ],
)  # fmt: skip
def test_v12_reports_whether_the_ego_can_stop_in_sight(
    mor_m: float, told: str, specs: dict[str, Spec]
):
    spec = specs["ui_fog_day_sparse"]
    fog = spec.weather.fog.model_copy(update={"mor_m": mor_m})
    weather = spec.weather.model_copy(update={"fog": fog})

    facts = describe_spec(spec.model_copy(update={"weather": weather, "conflicts": ()}))

    assert facts["stopping"].endswith(told)


def test_v12_reports_whether_the_ego_can_stop_for_a_pedestrian_seen_late(specs: dict[str, Spec]):
    spec = specs["unj_clear_day_sparse"]
    first, *others = spec.conflicts
    hidden = first.model_copy(update={"parameters": first.parameters | {"occlusion_m": 12.0}})

    found = compute_stopping_distance(spec.model_copy(update={"conflicts": (*others, hidden)}))

    assert spec.ego.blueprint is not None
    half_m = spec.blueprints[spec.ego.blueprint].length_m / 2
    assert found.occlusion_m == pytest.approx(12.0 - half_m, abs=0.01)
    assert not found.can_stop_in_sight
    assert str(found).endswith("10 m past parked cars: the ego cannot stop in sight")
    assert compute_stopping_distance(spec).occlusion_m is None

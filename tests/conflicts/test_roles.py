"""Who takes part in staged conflicts, in annotations and for whoever reads them."""

from dataclasses import replace

from advercity_dsl import Spec
from advercity_dsl.conflict import StagedActor, StagedConflict

from advercity.conflicts.roles import find_conflict_roles
from advercity.dataset.frame_documents import build_object_extras
from advercity.sensors.annotation import annotate_actors
from tests.builders import SensorFramesOf


def staged(spec: Spec) -> Spec:
    """The van turns across the ego's path; then the walker steps out from behind the truck."""
    turning = StagedConflict.model_construct(
        id="conflict_1",
        ego="other",
        actors=(StagedActor.model_construct(number=201, part="subject"),),
    )
    stepping = StagedConflict.model_construct(
        id="conflict_2",
        ego="subject",
        actors=(
            StagedActor.model_construct(number=203, part="other"),
            StagedActor.model_construct(number=204, part="bystander"),
        ),
    )
    return spec.model_copy(update={"conflicts": (turning, stepping)})


def test_all_participants_have_roles(spec: Spec) -> None:
    assert find_conflict_roles(staged(spec)) == {
        101: {"conflict_1": "other", "conflict_2": "subject"},
        201: {"conflict_1": "subject"},
        203: {"conflict_2": "other"},
        204: {"conflict_2": "bystander"},
    }
    assert find_conflict_roles(spec.model_copy(update={"conflicts": ()})) == {}


def test_annotations_have_roles(spec: Spec, sensor_frames_of: SensorFramesOf) -> None:
    reading = replace(sensor_frames_of(0)[1], conflict_roles=find_conflict_roles(staged(spec)))
    found = {
        number: item["roles"]
        for number, item in build_object_extras(reading, annotate_actors(reading))[
            "objects"
        ].items()
    }
    assert found["201"] == {"conflict_1": "subject"}
    assert found["101"] == {"conflict_1": "other", "conflict_2": "subject"}
    assert found["202"] == {}

"""Who takes part in staged conflicts, in annotations and for whoever reads them."""

from collections.abc import Callable
from dataclasses import replace

from advercity_dsl import Spec
from advercity_dsl.conflict import StagedActor, StagedConflict

from advercity.dataset.annotation import annotate
from advercity.dataset.extras import extras
from advercity.dataset.reading import Reading
from advercity.dataset.roles import roles_of


def staged(spec: Spec) -> Spec:
    """The van turns across the ego's way; then the walker steps out from behind the truck."""
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


def test_all_who_take_part_have_roles(spec: Spec) -> None:
    assert roles_of(staged(spec)) == {
        101: {"conflict_1": "other", "conflict_2": "subject"},
        201: {"conflict_1": "subject"},
        203: {"conflict_2": "other"},
        204: {"conflict_2": "bystander"},
    }
    assert roles_of(spec.model_copy(update={"conflicts": ()})) == {}


def test_annotations_tell_roles(
    spec: Spec, readings_of: Callable[[int], tuple[Reading, ...]]
) -> None:
    reading = replace(readings_of(0)[1], roles=roles_of(staged(spec)))
    found = {
        number: item["roles"]
        for number, item in extras(reading, annotate(reading))["objects"].items()
    }
    assert found["201"] == {"conflict_1": "subject"}
    assert found["101"] == {"conflict_1": "other", "conflict_2": "subject"}
    assert found["202"] == {}

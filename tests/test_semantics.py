"""Semantic tags and their colours are those that the documentation of CARLA 0.9.12 lists."""

import numpy as np
import pytest

from advercity.dataset.image_codec import to_semantic_colours
from advercity.semantics import Semantic

CARLA_0_9_12 = (
    (0, "UNLABELED", (0, 0, 0)),
    (1, "BUILDING", (70, 70, 70)),
    (2, "FENCE", (100, 40, 40)),
    (3, "OTHER", (55, 90, 80)),
    (4, "PEDESTRIAN", (220, 20, 60)),
    (5, "POLE", (153, 153, 153)),
    (6, "ROAD_LINE", (157, 234, 50)),
    (7, "ROAD", (128, 64, 128)),
    (8, "SIDEWALK", (244, 35, 232)),
    (9, "VEGETATION", (107, 142, 35)),
    (10, "VEHICLE", (0, 0, 142)),
    (11, "WALL", (102, 102, 156)),
    (12, "TRAFFIC_SIGN", (220, 220, 0)),
    (13, "SKY", (70, 130, 180)),
    (14, "GROUND", (81, 0, 81)),
    (15, "BRIDGE", (150, 100, 100)),
    (16, "RAIL_TRACK", (230, 150, 140)),
    (17, "GUARD_RAIL", (180, 165, 180)),
    (18, "TRAFFIC_LIGHT", (250, 170, 30)),
    (19, "STATIC", (110, 190, 160)),
    (20, "DYNAMIC", (170, 120, 50)),
    (21, "WATER", (45, 60, 150)),
    (22, "TERRAIN", (145, 170, 100)),
)


def test_there_are_no_other_tags() -> None:
    assert {tag.name for tag in Semantic} == {name for _, name, _ in CARLA_0_9_12}


@pytest.mark.parametrize(("number", "name", "colour"), CARLA_0_9_12)
def test_a_tag_has_the_number_and_the_colour_of_carla(
    number: int, name: str, colour: tuple[int, int, int]
) -> None:
    assert Semantic[name] == number
    painted = to_semantic_colours(np.full((2, 3), Semantic[name], np.uint8))
    np.testing.assert_array_equal(painted, np.broadcast_to(colour, (2, 3, 3)))

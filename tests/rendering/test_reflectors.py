"""Boxes around the thin things of a world."""

import numpy as np

from advercity.rendering.reflectors import find_reflector_boxes
from advercity.semantics import Semantic
from advercity.testing import build_box


def test_boxes_hold_all_triangles_of_thin_things_and_no_others() -> None:
    poles = [
        build_box((0.1, 0.1, 5.0), (x, y, 0.0), semantic=Semantic.POLE)
        for x, y in ((10.5, 0.5), (10.5, 7.5), (-30.2, 4.4))
    ]
    sign = build_box((0.02, 0.6, 0.6), (10.5, 0.5, 2.0), semantic=Semantic.TRAFFIC_SIGN)
    house = build_box((10.0, 10.0, 8.0), (50.0, 0.0, 0.0), semantic=Semantic.BUILDING)
    boxes = find_reflector_boxes([*poles, sign, house])
    assert boxes.shape[1:] == (2, 3)
    for mesh in (*poles, sign):
        for triangle in mesh.vertices[mesh.triangles]:
            inside = (triangle >= boxes[:, :1]).all(axis=2) & (triangle <= boxes[:, 1:]).all(axis=2)
            assert inside.all(axis=1).any()
    assert boxes[:, 1, 0].max() < 12
    assert (boxes[:, 1] - boxes[:, 0])[:, :2].max() < 2.0


def test_a_world_of_houses_has_no_thin_things() -> None:
    house = build_box((10.0, 10.0, 8.0), (50.0, 0.0, 0.0), semantic=Semantic.BUILDING)
    assert (
        np.shape(find_reflector_boxes([house])) == np.shape(find_reflector_boxes([])) == (0, 2, 3)
    )

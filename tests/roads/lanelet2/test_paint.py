"""Painted lines of Lanelet2 maps."""

from pathlib import Path

import numpy as np
import pytest
from advercity_dsl import Road

from advercity.roads.road_network import build_road
from tests.roads.imported_roads import declaration
from tests.roads.lanelet2_maps import LaneletMap, import_lanelets, import_text


def write_street(**tags: str) -> LaneletMap:
    """Write a lane of 90 m whose left bound, at y = 3, has tags; its right one is not painted."""
    lanelets = LaneletMap()
    left = lanelets.way([(0.0, 3.0), (90.0, 3.0)], **tags)
    lanelets.lanelet(left, lanelets.way([(0.0, 0.0), (90.0, 0.0)], "curbstone", subtype="high"))
    return lanelets


@pytest.mark.parametrize(
    ("tags", "stripes"),
    [
        ({"subtype": "solid"}, [("solid_white", 3.0)]),
        ({"subtype": "dashed", "color": "yellow"}, [("broken_yellow", 3.0)]),
        ({"subtype": "dashed_solid"}, [("broken_white", 3.12), ("solid_white", 2.88)]),
        ({"subtype": "solid_dashed"}, [("solid_white", 3.12), ("broken_white", 2.88)]),
        (
            {"subtype": "solid", "kind": "line_thick"},
            [("solid_white", 3.06), ("solid_white", 2.94)],
        ),
        ({"subtype": "low", "kind": "curbstone"}, []),
        ({"kind": "virtual"}, []),
    ],
)
def test_lines_have_the_style_and_colour_of_the_map(
    tags: dict[str, str], stripes: list[tuple[str, float]], tmp_path: Path
) -> None:
    network = import_lanelets(tmp_path, write_street(**tags))

    found = [(item.mark.value, float(item.line[0, 1])) for item in network.stripes]
    assert found == stripes


def test_only_the_lines_of_the_map_are_painted(tmp_path: Path) -> None:
    network = import_text(tmp_path, write_street(subtype="dashed").write())
    described = Road.model_validate(declaration("lanelet2", "map.osm"))

    meshes = build_road(described.model_copy(update={"imported": network})).meshes

    paint = [mesh for mesh in meshes if mesh.material.startswith("paint_")]
    vertices = np.concatenate([mesh.vertices for mesh in paint])
    assert {mesh.material for mesh in paint} == {"paint_white"}
    assert (vertices[:, 1].min(), vertices[:, 1].max()) == pytest.approx((2.94, 3.06), abs=1e-3)
    # Dashes are 3 m long, 12 m apart, the first from 4.5 m on.
    assert np.unique(vertices[:, 0].round(2))[:4].tolist() == [4.5, 7.5, 16.5, 19.5]

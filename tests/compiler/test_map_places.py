"""Roads of maps are where the maps are."""

from pathlib import Path

import pytest
from advercity_dsl import MapNetwork, Vehicle

from advercity.errors import InputError
from tests.roads.imported_roads import compiled, declaration, vehicle
from tests.roads.opendrive_maps import import_text, lane, road, section

UTM = "<geoReference>+proj=utm +zone=32 +datum=WGS84</geoReference>"
START = (691600.0, 5335000.0)
AGENTS = {
    "cav1": vehicle((START[0] + 20, START[1] - 1.75), 0, (START[0] + 180, START[1] - 1.75), "ego"),
    "rsu": {"kind": "roadside_unit", "position_m": [START[0] + 50, START[1] + 9, 6], "yaw_deg": 0},
}
TREES = {"kind": "trees", "area_m": [[START[0], START[1] + 20], [START[0] + 40, START[1] + 40]]}


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    lanes = section(0.0, lane(1, "driving", 3.5), lane(-1, "driving", 3.5))
    import_text(tmp_path, road("1", 200.0, lanes, start=(*START, 0.0)), header=UTM)
    return tmp_path


def test_declared_places_move_with_the_map(library: Path, folder: Path) -> None:
    made = compiled(
        library, folder, declaration("opendrive", "map.xodr", agents=AGENTS, surroundings=[TREES])
    ).road

    assert isinstance(made.imported, MapNetwork)
    assert made.imported.offset_m == START
    ego = made.agents["cav1"]
    assert isinstance(ego, Vehicle)
    assert (ego.spawn_m, ego.destination_m) == ((20, -1.75), (180, -1.75))
    assert made.surroundings[0].area_m == ((0, 20), (40, 40))
    assert made.origin_lat_deg == pytest.approx(48.13937796639, abs=1e-8)
    assert made.origin_lon_deg == pytest.approx(11.57555823893, abs=1e-8)
    assert made.origin_convergence_deg == pytest.approx(1.91878, abs=1e-4)


def test_a_road_that_declares_another_origin_is_told(library: Path, folder: Path) -> None:
    elsewhere = declaration("opendrive", "map.xodr", agents=AGENTS, origin_lat_deg=48.2)

    with pytest.raises(InputError, match=r"puts the origin at 48\.139378, 11\.575558"):
        compiled(library, folder, elsewhere)

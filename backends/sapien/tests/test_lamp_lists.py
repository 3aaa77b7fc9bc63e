"""Lists of the lamps of cells, tiles and bearings, without a device."""

import numpy as np
import pytest
from advercity_sapien.lamp_lists import LampLists
from advercity_sapien.shader_table import (
    BEARINGS,
    CELL_LAMPS,
    COLUMNS,
    GRID_CELLS,
    LAMPS_PER_BEARING,
    LAMPS_PER_TILE,
    TILES_HIGH,
    TILES_WIDE,
    ShaderTable,
)
from numpy.typing import NDArray

from advercity.geometry.poses import pose_matrix
from advercity.physics.lamp_beams import LampPattern, LightSource
from advercity.rendering.backend import CameraView
from tests.render_builders import build_clear_air

VIEW = CameraView(pose_matrix((0.0, 0.0, 1.5)), 160, 90, np.radians(90.0))


def street_lamp(x: float, y: float, intensity_cd: float = 1000.0) -> LightSource:
    facing = (0.0, 0.0, -1.0)
    return LightSource(LampPattern.STREET, (x, y, 8.0), facing, intensity_cd, (1.0, 1.0, 1.0))


def write(*lamps: LightSource) -> tuple[LampLists, ShaderTable]:
    lists, table = LampLists(lamps, build_clear_air(night=True)), ShaderTable()
    lists.write_to(table, VIEW)
    return lists, table


def entries(table: ShaderTable, section: str, lists: int, length: int) -> NDArray[np.float32]:
    """Lists (lists, length) of a section."""
    return table.section(section).reshape(-1)[: lists * length].reshape(lists, length)


def listed(table: ShaderTable, cell: int) -> list[int]:
    """Lamps of a cell."""
    first, end = table.section("cells").reshape(-1, 4)[cell, :2].astype(int)
    lamps = table.section("cell_lamps").reshape(-1)[4 * first : 4 * end]
    return lamps[lamps >= 0].astype(int).tolist()


def cell_of(lists: LampLists, x: float, y: float) -> int:
    left, low, per_x, per_y = lists.cell_grid
    return int((y - low) * per_y) * GRID_CELLS + int((x - left) * per_x)


def test_without_lamps_every_list_is_empty() -> None:
    _, table = write()
    assert listed(table, 0) == listed(table, GRID_CELLS**2 - 1) == []
    assert (entries(table, "tiles", TILES_HIGH * TILES_WIDE, LAMPS_PER_TILE) == -1).all()
    assert (entries(table, "bearings", BEARINGS, LAMPS_PER_BEARING) == -1).all()


@pytest.mark.parametrize("number", range(5))
def test_a_cell_lists_the_lamp_above_it(number: int) -> None:
    lamps = [street_lamp(60.0 * index, 10.0, 1000.0 - index) for index in range(5)]
    lists, table = write(*lamps)
    assert number in listed(table, cell_of(lists, 60.0 * number, 10.0))


def test_a_cell_lists_every_lamp_that_lights_it() -> None:
    lists, table = write(*[street_lamp(0.5 * index, 0.0) for index in range(75)])
    assert listed(table, cell_of(lists, 18.0, 0.0)) == list(range(75))


def test_lists_that_are_longer_than_their_room_keep_the_brightest_lamps() -> None:
    lamps = [street_lamp(index % 8, index // 8, 1e5 * (index + 1)) for index in range(COLUMNS)]
    lists, table = write(*lamps)
    found = [listed(table, cell) for cell in range(GRID_CELLS**2)]
    kept = sum(map(len, found))
    assert CELL_LAMPS - 4 * GRID_CELLS**2 < kept <= CELL_LAMPS
    # The table has the brightest first.
    assert 0 in found[cell_of(lists, 7.0, 63.0)]
    assert not any(COLUMNS - 1 in cell for cell in found)


def test_a_bearing_lists_the_lamps_in_its_direction() -> None:
    _, table = write(street_lamp(50.0, 0.1), street_lamp(-50.0, 0.1))
    bearings = entries(table, "bearings", BEARINGS, LAMPS_PER_BEARING)
    ahead, behind = bearings[BEARINGS // 2], bearings[BEARINGS - 1]
    assert (ahead[:2].tolist(), behind[:2].tolist()) == ([0, -1], [1, -1])


def test_only_the_brightest_lamps_are_in_the_table() -> None:
    lamps = [street_lamp(index % 40, index // 40, 1.0 + index) for index in range(COLUMNS + 20)]
    _, table = write(*lamps)
    kcd = table.section("lamps").reshape(COLUMNS, 4, 4)[:, 2, 0]
    assert kcd[0] == pytest.approx((COLUMNS + 20) / 1000.0)
    assert kcd.min() == pytest.approx(21 / 1000.0)


def test_both_lamps_of_a_pair_light_distant_cells_as_one() -> None:
    left, right = (
        LightSource(LampPattern.LOW_BEAM, (0.0, y, 0.7), (1.0, 0.0, 0.0), 2e4, (1.0, 1.0, 1.0))
        for y in (0.6, -0.6)
    )
    lists, table = write(left, right)
    near, far = (listed(table, cell_of(lists, x, 0.0)) for x in (5.0, 80.0))
    assert (near, far) == ([0, 1], [COLUMNS])


def test_a_lamp_beside_a_pair_is_not_taken_for_one_of_it() -> None:
    beams = [
        LightSource(LampPattern.LOW_BEAM, (0.0, y, 0.7), (1.0, 0.0, 0.0), 2e4, (1.0, 1.0, 1.0))
        for y in (2.0, 0.0, -2.0)
    ]
    lists, table = write(*beams)
    assert listed(table, cell_of(lists, 80.0, 0.0)) == [COLUMNS, 2]

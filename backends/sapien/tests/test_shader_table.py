"""The description of the shader table, and the GLSL generated from it."""

import numpy as np
import pytest
from advercity_sapien.shader_constants import SHADER_FOLDER, format_shader_files
from advercity_sapien.shader_table import (
    CARRIED_TEXTURES,
    COLUMNS,
    FIRST_ROWS,
    PARAMETERS,
    TABLE_ROWS,
    ShaderTable,
)


@pytest.mark.parametrize("name", format_shader_files())
def test_generated_shader_files_are_current(name: str) -> None:
    committed = (SHADER_FOLDER / name).read_text()
    assert committed == format_shader_files()[name], (
        "run python -m advercity_sapien.shader_constants"
    )


def test_no_two_parameters_have_a_component_in_common() -> None:
    used = np.zeros((COLUMNS, 4), dtype=int)
    for parameter in PARAMETERS:
        used[parameter.slices] += 1
    assert used.max() == 1


def test_sections_follow_each_other_without_overlap() -> None:
    table = ShaderTable()
    for name in FIRST_ROWS:
        table.section(name)[:] += 1.0
    assert (table.texels == 1.0).all()
    assert table.texels.shape == (TABLE_ROWS, COLUMNS, 4)


def test_each_parameter_lands_where_its_accessor_reads_it() -> None:
    table = ShaderTable()
    values = {p.name: np.arange(p.count * len(p.components)) + 1.0 for p in PARAMETERS}
    table.set_parameters(**values)
    for parameter in PARAMETERS:
        read = table.texels[0][parameter.slices]
        np.testing.assert_array_equal(read.ravel(), values[parameter.name])


def test_each_texture_has_a_material_slot_of_its_own() -> None:
    assert len({texture.material_slot for texture in CARRIED_TEXTURES}) == len(CARRIED_TEXTURES)

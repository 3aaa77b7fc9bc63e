"""A spec for commands."""

from pathlib import Path

import pytest
from advercity_dsl import Spec

from advercity.compiler import write_specs


@pytest.fixture
def spec_file(specs: dict[str, Spec], tmp_path: Path) -> Path:
    """A compiled spec on disk."""
    write_specs([specs["rcnj_fog_day_sparse"]], tmp_path / "compiled")
    return tmp_path / "compiled" / "rcnj_fog_day_sparse.json"

"""Kinds of sensors of other distributions, as an installation with such a distribution has them."""

import subprocess
import sys
from pathlib import Path

import pytest

MODULE = """
from typing import Annotated
from advercity_dsl.base import Items
from advercity_dsl.mount import Mount
from advercity_dsl.sampling import Sampled
from advercity_dsl.sensor_kind import SensorKind
from pydantic import Field

class Whisker(Sampled):
    \"\"\"A whisker.\"\"\"

    length_m: Annotated[float, Field(ge=0, le=1)] = 0.3
    \"\"\"How long it is.\"\"\"
    mounts: Items[Mount]
    \"\"\"Pose of each.\"\"\"

KIND = SensorKind("whisker", "whisker", Whisker, "aimed", files="none:F", driver="none:D")
"""
WHISKERS = ", 'whisker': {'mounts': [{}, {}]}"
RIG = f"Rig(id='a', vehicle={{'camera': {{'mounts': [{{}}]}}, 'lidar': {{}}{WHISKERS}}})"


def install(
    folder: Path,
    *,
    name: str = "whiskers",
    module: str = MODULE,
    group: str = "advercity.sensors",
    **entries: str,
) -> None:
    """Install a distribution with entry points, by name, into a folder."""
    (folder / f"{name}.py").write_text(module)
    info = folder / f"{name}-1.dist-info"
    info.mkdir()
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 1\n")
    lines = [f"{name} = {value}" for name, value in entries.items()]
    (info / "entry_points.txt").write_text("\n".join([f"[{group}]", *lines, ""]))


def run(folder: Path, code: str) -> str:
    """Run code where the distribution is installed, and return what it prints."""
    path = [str(folder), *sys.path]
    done = subprocess.run(
        [sys.executable, "-c", f"import sys; sys.path[:] = {path!r}; {code}"],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout.strip()


@pytest.mark.parametrize("first", ["import whiskers", "import advercity_dsl"])
def test_rigs_have_the_key_whichever_is_imported_first(tmp_path: Path, first: str) -> None:
    install(tmp_path, whisker="whiskers:KIND")
    code = f"{first}; from advercity_dsl import Rig; sensors = {RIG}.vehicle;"
    printed = run(tmp_path, f"{code} print(sensors.list_sensors('whisker')[1].model.length_m)")
    assert printed == "0.3"


def test_specs_without_the_sensor_do_not_mention_it(tmp_path: Path) -> None:
    install(tmp_path, whisker="whiskers:KIND")
    rig = RIG.replace(WHISKERS, "")
    code = f"from advercity_dsl import Rig; print('whisker' in {rig}.model_dump_json())"
    assert run(tmp_path, code) == "False"


def test_the_schema_describes_the_sensor(tmp_path: Path) -> None:
    install(tmp_path, whisker="whiskers:KIND")
    code = (
        "from advercity.compiler.schema import build_schema; found = build_schema('rig')['$defs'];"
    )
    code += "print(found['Whisker']['properties']['length_m']['description'], *found['SensorSet']"
    code += "['properties']['whisker']['anyOf'][0].values())"
    assert run(tmp_path, code) == "How long it is. #/$defs/Whisker"


@pytest.mark.parametrize(
    ("module", "entries", "reason"),
    [
        ("1 / 0", {"whisker": "whiskers:KIND"}, "division by zero"),
        (MODULE.replace("(Sampled)", ""), {"whisker": "whiskers:KIND"}, "not derived from Sampled"),
        ("import nowhere", {"whisker": "whiskers:KIND"}, "No module named 'nowhere'"),
        (MODULE, {"whisker": "whiskers:NONE"}, "has no attribute 'NONE'"),
        (MODULE, {"tail": "whiskers:KIND"}, "is no SensorKind with the name 'tail'"),
        (MODULE, {"lidar": "whiskers:KIND"}, "the name is claimed by advercity, whiskers:KIND"),
    ],
)
def test_a_kind_that_cannot_be_used_leaves_all_others(
    tmp_path: Path, module: str, entries: dict[str, str], reason: str
) -> None:
    install(tmp_path, module=module, **entries)
    code = "from advercity_dsl.sensor_kinds import CORE_KINDS, load_sensor_kinds as load;"
    printed = run(tmp_path, f"{code} print(load().found == CORE_KINDS, *load().broken.values())")
    assert printed.startswith("True ")
    assert reason in printed

"""Times opening a dataset against importing what any reader of such files imports.

python benchmarks/reader.py [ROUNDS]
"""

import sys
import tempfile
from pathlib import Path

from measurement import Measurement, format_table, measure_command_cpu_s

from advercity.compiler import read_spec
from advercity.dataset.manifest import Identity, Manifest
from advercity.dataset.partial_files import FileRecord
from advercity.dataset.scenario_folders import MANIFEST_FILE

SPEC = Path(__file__).parent.parent / "compiled" / "ui_fog_day_sparse.json"
NUM_FRAMES, FILES_PER_FRAME = 300, 64
BASELINE_IMPORTS = "import numpy, pydantic, yaml"
"""Imports that a reader of the manifest and of the YAML files cannot do without."""


def run_benchmark(*, quick: bool, rounds: int | None = None) -> list[Measurement]:
    """Measure opening a dataset of one scenario with a manifest as long as that of a whole run."""
    count = rounds or (5 if quick else 15)
    with tempfile.TemporaryDirectory() as folder:
        _write_manifest(Path(folder))
        code = f"import advercity; advercity.open_dataset({folder!r})"
        opening_s = measure_command_cpu_s(count, sys.executable, "-c", code)
    baseline_s = measure_command_cpu_s(count, sys.executable, "-c", BASELINE_IMPORTS)
    against = "importing numpy, pydantic and yaml"
    return [
        Measurement("`open_dataset`, processor time", opening_s / baseline_s, against, at_most=1.8)
    ]


def _write_manifest(folder: Path) -> None:
    spec = read_spec(SPEC)
    identity = Identity.for_spec(spec, trace_sha256="0" * 64, world_sha256="0" * 64, renderer={})
    files = {
        f"+101/{frame:06d}_{number}.png": FileRecord(size=1000, sha256="0" * 64, frame=frame)
        for frame in range(NUM_FRAMES)
        for number in range(FILES_PER_FRAME)
    }
    manifest = Manifest.from_files(identity, spec, length=NUM_FRAMES, files=files)
    (folder / MANIFEST_FILE).write_text(manifest.to_json())


if __name__ == "__main__":
    asked = int(sys.argv[1]) if len(sys.argv) > 1 else None
    print(format_table(run_benchmark(quick=True, rounds=asked)))

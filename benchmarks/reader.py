"""Times opening a dataset against importing what any reader of such files imports.

python benchmarks/reader.py [ROUNDS]
"""

import sys
import tempfile
from pathlib import Path

from compile import median_s, process
from measurement import Figure, table

from advercity.compiler import read_spec
from advercity.dataset.manifest import Identity, Manifest
from advercity.dataset.partial_files import FileRecord
from advercity.dataset.scenario_folders import MANIFEST_FILE

SPEC = Path(__file__).parent.parent / "compiled" / "ui_fog_day_sparse.json"
NUM_FRAMES, FILES_PER_FRAME = 300, 64
PEER = "import numpy, pydantic, yaml"
"""What a reader of the manifest and of the YAML files cannot do without."""


def figures(*, quick: bool, rounds: int | None = None) -> list[Figure]:
    """Open a dataset of one scenario whose manifest is as long as a whole run makes it."""
    count = rounds or (5 if quick else 15)
    with tempfile.TemporaryDirectory() as folder:
        _write_manifest(Path(folder))
        code = f"import advercity; advercity.open_dataset({folder!r})"
        opening_s = median_s(process(sys.executable, "-c", code), count)
    peer_s = median_s(process(sys.executable, "-c", PEER), count)
    against = "importing numpy, pydantic and yaml"
    return [Figure("`open_dataset`, processor time", opening_s / peer_s, against, at_most=1.8)]


def _write_manifest(folder: Path) -> None:
    spec = read_spec(SPEC)
    identity = Identity.for_spec(spec, trace_sha256="0" * 64, renderer={})
    files = {
        f"+101/{frame:06d}_{number}.png": FileRecord(size=1000, sha256="0" * 64, frame=frame)
        for frame in range(NUM_FRAMES)
        for number in range(FILES_PER_FRAME)
    }
    manifest = Manifest.from_files(identity, spec, length=NUM_FRAMES, files=files)
    (folder / MANIFEST_FILE).write_text(manifest.to_json())


if __name__ == "__main__":
    asked = int(sys.argv[1]) if len(sys.argv) > 1 else None
    print(table(figures(quick=True, rounds=asked)))

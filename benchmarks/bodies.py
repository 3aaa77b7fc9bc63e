"""How long the bodies of a scenario take to load: `python benchmarks/bodies.py [SPEC]`."""

import resource
import sys
from pathlib import Path

import numpy as np
from measurement import Measurement, format_table, measure_run_time
from numpy.typing import NDArray

from advercity.assets.bodies import build_body
from advercity.assets.catalogue import compute_body_facts
from advercity.assets.model_store import open_model_store
from advercity.assets.rigged_bodies import compute_extent
from advercity.compiler import read_spec
from advercity.geometry.mesh import Size

SPEC = Path("compiled/ui_clear_day_dense.json")


def run_benchmark(*, quick: bool, spec_path: Path = SPEC) -> list[Measurement]:
    """Measure loading all bodies once; quick or not, as memory must be that of a fresh process."""
    spec, store = read_spec(spec_path), open_model_store()
    # Models of an asset pack are converted on first use, which is not measured here.
    models = [store.prepare_model(blueprint) for blueprint in spec.blueprints.values()]

    def load_bodies() -> None:
        for name, blueprint in spec.blueprints.items():
            build_body(name, blueprint, store)

    loaded_s = measure_run_time(load_bodies).cpu_s
    peak_mib = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    facts = [compute_body_facts(name, item, store) for name, item in spec.blueprints.items()]
    gaps_m = [
        np.abs(np.concatenate(compute_extent(body)) - _list_box_corners(body.size)).max()
        for name, item in spec.blueprints.items()
        for body in [build_body(name, item, store)]
    ]
    meshes_mib = sum(fact.size_mib for fact in facts)
    what = f"{len(facts)} bodies, {sum(model is not None for model in models)} of them models"
    return [
        Measurement(f"load {what}, processor time", loaded_s, "s", at_most=5.0),
        Measurement("memory of a process with all bodies", peak_mib, "MiB", at_most=600.0),
        Measurement(
            "largest gap between a body and its box", 1e3 * max(gaps_m), "mm", at_most=50.0
        ),
        Measurement("meshes of all bodies", meshes_mib, "MiB"),
        Measurement("triangles of all bodies", sum(fact.triangles for fact in facts), "triangles"),
    ]


def _list_box_corners(size: Size) -> NDArray[np.float64]:
    """List lowest and highest coordinates (6,) of a box on the ground."""
    length, width, height = size
    return np.array([-length / 2, -width / 2, 0.0, length / 2, width / 2, height])


if __name__ == "__main__":
    print(format_table(run_benchmark(quick=False, spec_path=Path([*sys.argv, SPEC][1]))))

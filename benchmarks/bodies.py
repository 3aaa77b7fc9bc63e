"""How long the bodies of a scenario take to load from the cache, and what they weigh.

python benchmarks/bodies.py [SPEC]
"""

import resource
import sys
import time
from pathlib import Path

from advercity.assets.bodies import build_body
from advercity.assets.catalogue import compute_body_facts
from advercity.compiler import read_spec
from advercity.pipeline.cache import open_model_store

DENSEST = Path("compiled/ui_clear_day_dense.json")


def main() -> None:
    """Print seconds, triangles and memory."""
    spec = read_spec(Path(sys.argv[1]) if len(sys.argv) > 1 else DENSEST)
    here = open_model_store()
    models = sum(
        here.prepare_model(blueprint) is not None for blueprint in spec.blueprints.values()
    )
    started, before = time.perf_counter(), time.process_time()
    for name, blueprint in spec.blueprints.items():
        build_body(name, blueprint, here)
    wall, used = time.perf_counter() - started, time.process_time() - before
    facts = [
        compute_body_facts(name, blueprint, here) for name, blueprint in spec.blueprints.items()
    ]
    triangles = sum(row.triangles for row in facts)
    size_mib = sum(row.size_mib for row in facts)
    peak_mib = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    print(f"{spec.id}: {len(facts)} bodies, {models} of them models, {triangles} triangles")
    print(f"loaded in {wall:.2f} s ({used:.2f} s of CPU); {size_mib:.1f} MiB of meshes")
    print(f"peak of the whole process {peak_mib:.0f} MiB")


if __name__ == "__main__":
    main()

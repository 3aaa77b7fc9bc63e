"""How long the bodies of a scenario take to load from the cache, and what they weigh.

python benchmarks/bodies.py [SPEC]
"""

import resource
import sys
import time
from pathlib import Path

from advercity.compiler import read_spec
from advercity.runner.bodies import facts_of
from advercity.runner.cache import shelf
from advercity.world.bodies import body

DENSEST = Path("compiled/ui_clear_day_dense.json")


def main() -> None:
    """Print seconds, triangles and memory."""
    spec = read_spec(Path(sys.argv[1]) if len(sys.argv) > 1 else DENSEST)
    here = shelf()
    models = sum(here.find(blueprint) is not None for blueprint in spec.blueprints.values())
    started, before = time.perf_counter(), time.process_time()
    for name, blueprint in spec.blueprints.items():
        body(name, blueprint, here)
    wall, used = time.perf_counter() - started, time.process_time() - before
    facts = [facts_of(name, blueprint, here) for name, blueprint in spec.blueprints.items()]
    triangles = sum(row.triangles for row in facts)
    size_mib = sum(row.size_mib for row in facts)
    peak_mib = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    print(f"{spec.id}: {len(facts)} bodies, {models} of them models, {triangles} triangles")
    print(f"loaded in {wall:.2f} s ({used:.2f} s of CPU); {size_mib:.1f} MiB of meshes")
    print(f"peak of the whole process {peak_mib:.0f} MiB")


if __name__ == "__main__":
    main()

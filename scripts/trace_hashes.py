#!/usr/bin/env python
"""Write the checksums of the ten traces of the 110 scenarios, which tests compare on every machine.

To be run after a change that moves actors; the commit says why they moved.
"""

import json
from pathlib import Path

from advercity.compiler import read_spec
from advercity.pipeline.preparation import load_or_simulate_traffic

ROOT = Path(__file__).resolve().parent.parent
HASHES = ROOT / "tests" / "data" / "trace_hashes.json"
WEATHER = "clear_day"
"""Weathers share traces, so that one of them represents all."""


def main() -> None:
    """Simulate what the cache lacks, and write."""
    specs = [read_spec(path) for path in sorted(ROOT.glob(f"compiled/*_{WEATHER}_*.json"))]
    hashes = {spec.id: load_or_simulate_traffic(spec).trace_sha256 for spec in specs}
    HASHES.write_text(json.dumps(hashes, indent=2) + "\n")


if __name__ == "__main__":
    main()

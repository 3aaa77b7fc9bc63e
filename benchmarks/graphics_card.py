"""Pictures on a graphics card against SAPIEN's: `python benchmarks/graphics_card.py [SPEC ...]`.

The ego's front camera in milliseconds by the clock, until its pixels are in the computer's memory:
previews, 1920x1080, and 1920x1080 traced as under the profile `full`, each against SAPIEN's pack of
that kind on the same bodies, with as many samples and as deep paths. Each is measured in a process
of its own, since two packs do not mix; then our traced picture in two, whose bytes are compared,
and denoised, which the processor does.
"""

import argparse
import hashlib
import statistics
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from itertools import chain
from multiprocessing import get_context
from pathlib import Path
from typing import NamedTuple

from advercity_sapien.backend import find_vulkan_device
from benchmark_scene import BenchmarkScene
from measurement import RunTime, measure_run_time
from stock_renderer import StockRenderer

from advercity.rendering.backend import RENDER_PROFILES, RenderProfile, load_backend

SPECS = tuple(
    Path(f"compiled/ui_{weather}_dense.json")
    for weather in ("clear_day", "fog_day", "clear_night", "heavy_rain_night")
)
FRAME, ROUNDS, WARM_UP = 40, 5, 2
PREVIEW, FULL = RENDER_PROFILES["preview"], RENDER_PROFILES["full"]
TRACED = replace(FULL, denoise=False)
PROFILES = {
    "preview": PREVIEW,
    "1920x1080": PREVIEW.with_scale(1.0),
    "1920x1080, traced": TRACED,
}


class Timed(NamedTuple):
    """Median time of our picture, and a digest of its radiance."""

    time_s: float
    digest: str


def measure_own(spec: Path, profile: RenderProfile) -> Timed:
    """Measure our picture."""
    scene = BenchmarkScene(spec, FRAME)
    view = scene.list_views(scene.ego, profile)[0]
    with load_backend("sapien").open(scene.world, scene.air, profile) as renderer:
        renderer.place(scene.frame)
        time_s = compute_median_s(lambda: measure_run_time(lambda: renderer.render_camera(view)))
        radiance = renderer.render_camera(view).radiance
    return Timed(time_s, hashlib.sha256(radiance.tobytes()).hexdigest())


def measure_stock(spec: Path, profile: RenderProfile) -> float:
    """Measure SAPIEN's picture of the same bodies."""
    scene = BenchmarkScene(spec, FRAME)
    views = scene.list_views(scene.ego, profile)[:1]
    traced = profile if profile.renderer == "ray_traced" else None
    with StockRenderer(spec, FRAME, views, traced=traced) as stock:
        return compute_median_s(stock.measure)


def compute_median_s(measure: Callable[[], RunTime]) -> float:
    """Compute the median time by the clock of rounds after a warm-up."""
    times_s = [measure().wall_s for _ in range(WARM_UP + ROUNDS)]
    return statistics.median(times_s[WARM_UP:])


def compare_pictures(pool: ProcessPoolExecutor, spec: Path) -> Iterator[str]:
    """Measure pictures of a scenario against SAPIEN's, as rows of a table."""
    for name, profile in PROFILES.items():
        stock_s = measure_stock(spec, profile)
        own_s = pool.submit(measure_own, spec, profile).result().time_s
        cells = f"{own_s * 1e3:.1f} | {stock_s * 1e3:.1f} | {own_s / stock_s:.2f}"
        yield f"| {spec.stem} | {name} | {cells} | |"


def measure_again(pool: ProcessPoolExecutor, spec: Path) -> Iterator[str]:
    """Measure traced pictures twice, and once denoised, as rows of a table."""
    first, again, denoised = (
        pool.submit(measure_own, spec, profile).result() for profile in (TRACED, TRACED, FULL)
    )
    verdict = "same bytes" if again.digest == first.digest else "OTHER BYTES"
    yield f"| {spec.stem} | 1920x1080, traced again | {again.time_s * 1e3:.1f} | | | {verdict} |"
    yield f"| {spec.stem} | 1920x1080, denoised | {denoised.time_s * 1e3:.1f} | | | |"


def main() -> None:
    """Print a table in Markdown."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("specs", nargs="*", type=Path, default=SPECS, metavar="SPEC")
    arguments = parser.parse_args()
    print(f"{find_vulkan_device().name}\n\n| scenario | picture | ms | SAPIEN's, ms | ratio | |")
    print("|---|---|---|---|---|---|")
    with ProcessPoolExecutor(1, mp_context=get_context("spawn"), max_tasks_per_child=1) as pool:
        for spec in arguments.specs:
            for row in chain(compare_pictures(pool, spec), measure_again(pool, spec)):
                print(row, flush=True)


if __name__ == "__main__":
    main()

"""Noise and light of Mitsuba's pictures against SAPIEN's: `python benchmarks/agreement.py`.

The ego's front camera at a sparse urban intersection, in clear air and fog, by day and night.

Noise is that of the profile `full` against a picture of 16 times its samples, with and without the
denoiser: the root mean square of relative errors of luminance, without the hundredth part of the
pixels that differ most (lenses and their mirror images, on which everything would depend), and the
median.

Light is the ratio of mean luminances by class, where all pictures show that class, to those of
SAPIEN's packs, without a denoiser. Of every class the hundredth part that is brightest in the
raster, which has no noise, is left out for the same reason. Ratios of SAPIEN's packs to each other
show how much of a difference is Mitsuba's.

    python benchmarks/agreement.py [--scale 0.1] [--samples 16] [SPEC ...]
"""

import argparse
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from multiprocessing import get_context
from pathlib import Path

import numpy as np
from benchmark_scene import BenchmarkScene
from numpy.typing import NDArray

from advercity.geometry.arrays import FloatArray
from advercity.physics.photometry import LUMINANCE_WEIGHTS
from advercity.rendering.backend import RENDER_PROFILES, CameraCapture, RenderProfile, load_backend
from advercity.semantics import Semantic

FRAME = 40
SPECS = tuple(
    Path(f"compiled/ui_{weather}_sparse.json")
    for weather in ("clear_day", "fog_day", "clear_night", "fog_night")
)
REFERENCE_FACTOR = 16
LEAST_PIXELS = 200
"""Pixels of a class below which its mean says little."""
KEPT_FRACTION = 0.99


def render(backend: str, spec: Path, profile: RenderProfile, frame_index: int) -> CameraCapture:
    """Render the picture; the index of the frame chooses random numbers alone."""
    scene = BenchmarkScene(spec, FRAME)
    (view, *_) = scene.list_views(scene.ego, profile)
    with load_backend(backend).open(scene.world, scene.air, profile) as renderer:
        renderer.place(replace(scene.frame, index=frame_index))
        return renderer.render_camera(view)


def compute_luminance(capture: CameraCapture) -> FloatArray:
    """Compute the luminance (h, w) of a capture, cd/m²."""
    return (capture.radiance @ LUMINANCE_WEIGHTS).astype(float)


def measure_noise(pool: ProcessPoolExecutor, spec: Path, scale: float) -> Iterator[str]:
    """Measure the noise of Mitsuba's picture, as rows of a table."""
    full = RENDER_PROFILES["full"].with_scale(scale)
    raw = replace(full, denoise=False)
    many = replace(raw, samples=raw.samples * REFERENCE_FACTOR)
    expected = compute_luminance(pool.submit(render, "mitsuba", spec, many, FRAME).result())
    for profile, name in ((raw, "as traced"), (full, "denoised")):
        # With the random numbers of the reference, its first samples would be the same.
        found = pool.submit(render, "mitsuba", spec, profile, FRAME + 1).result()
        error = np.abs(compute_relative_error(compute_luminance(found), expected))
        kept = np.sort(error, axis=None)[: int(KEPT_FRACTION * error.size)]
        rms, median = float(np.sqrt((kept**2).mean())), float(np.median(kept))
        yield f"| {spec.stem} | {name} | {rms:.1%} | {median:.1%} |"


def compute_relative_error(found: FloatArray, expected: FloatArray) -> FloatArray:
    """Compute errors relative to what is expected, of dark pixels to 1 % of the mean."""
    return (found - expected) / np.maximum(expected, 0.01 * expected.mean())


def measure_light(
    pool: ProcessPoolExecutor, spec: Path, scale: float, samples: int
) -> Iterator[str]:
    """Measure the light of Mitsuba's picture by class, as rows of a table."""
    traced = replace(RENDER_PROFILES["full"], scale=scale, samples=samples, denoise=False)
    many = replace(traced, samples=samples * REFERENCE_FACTOR)
    wanted = {
        "mitsuba": ("mitsuba", many),
        "raster": ("sapien", RENDER_PROFILES["preview"].with_scale(scale)),
        "traced": ("sapien", traced),
    }
    captures = {
        name: pool.submit(render, backend, spec, profile, FRAME).result()
        for name, (backend, profile) in wanted.items()
    }
    classes = [capture.semantic for capture in captures.values()]
    same: NDArray[np.bool_] = np.all([one == classes[0] for one in classes], axis=0)
    light = {name: compute_luminance(capture) for name, capture in captures.items()}
    for semantic in Semantic:
        where = same & (classes[0] == semantic)
        if np.count_nonzero(where) < LEAST_PIXELS:
            continue
        kept = light["raster"][where] <= np.quantile(light["raster"][where], KEPT_FRACTION)
        mean = {name: float(one[where][kept].mean()) for name, one in light.items()}
        ratios = [
            mean["mitsuba"] / mean["raster"],
            mean["mitsuba"] / mean["traced"],
            mean["traced"] / mean["raster"],
        ]
        cells = " | ".join(f"{ratio:.2f}" for ratio in ratios)
        name, area = semantic.name.lower(), float(where.mean())
        yield f"| {spec.stem} | {name} | {area:.1%} | {mean['mitsuba']:.3g} | {cells} |"


def main() -> None:
    """Measure both, and print tables in Markdown."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("specs", nargs="*", type=Path, default=SPECS, metavar="SPEC")
    parser.add_argument("--scale", type=float, default=0.1, help="of the authored image size")
    parser.add_argument("--samples", type=int, default=16, help="of SAPIEN's traced picture")
    arguments = parser.parse_args()
    # Two packs of shaders do not mix in a process.
    with ProcessPoolExecutor(1, mp_context=get_context("spawn"), max_tasks_per_child=1) as pool:
        print("| scenario | picture | RMS error | median |\n|---|---|---|---|")
        for spec in arguments.specs:
            for row in measure_noise(pool, spec, arguments.scale):
                print(row, flush=True)
        print("\n| scenario | class | area | cd/m² | over raster | over traced | traced/raster |")
        print("|---|---|---|---|---|---|---|")
        for spec in arguments.specs:
            for row in measure_light(pool, spec, arguments.scale, arguments.samples):
                print(row, flush=True)


if __name__ == "__main__":
    main()

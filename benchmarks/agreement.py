"""Noise and light of Mitsuba's pictures against SAPIEN's: `python benchmarks/agreement.py`.

The ego's front camera at a sparse urban intersection, in clear air and fog, by day and night.

Noise is that of the profile `full` against a picture of 16 times its samples, with and without the
denoiser: the root mean square of relative errors of luminance, without the hundredth part of the
pixels that differ most (lenses and their mirror images, on which everything would depend), and the
median.

Light is the ratio of mean luminances by class, where all pictures show that class, to those of
SAPIEN's packs, without a denoiser: of the picture of many samples to the raster, and to a traced
picture of the profile `full`. Of every class the hundredth parts that are brightest in the raster
and in the picture of many samples, which have little noise, are left out for the same reason: some
show edges of lenses, others not. Ratios of SAPIEN's packs to each other
show how much of a difference is Mitsuba's. The median is of the ratios of single pixels to the
raster. What differs from the raster by more than 5 % by day or 10 % by night is marked.

    python benchmarks/agreement.py [--scale 0.1] [--no-tracer] [SPEC ...]

SAPIEN's tracer takes most of the time on the software driver; `--no-tracer` leaves it out.
"""

import argparse
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from multiprocessing import get_context
from pathlib import Path

import numpy as np
from benchmark_scene import BenchmarkScene
from numpy.typing import NDArray

from advercity.compiler import read_spec
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
GOAL_BY_DAY, GOAL_BY_NIGHT = 0.05, 0.1
"""Differences of means from the raster that are wanted at most."""


@dataclass(frozen=True)
class Picture:
    """How a picture is rendered; the index of its frame chooses random numbers alone."""

    backend: str
    profile: RenderProfile
    frame_index: int = FRAME


def render(spec: Path, pictures: Sequence[Picture]) -> list[CameraCapture]:
    """Render pictures of one scenario, frame and camera."""
    scene = BenchmarkScene(spec, FRAME)
    captures: list[CameraCapture] = []
    for picture in pictures:
        (view, *_) = scene.list_views(scene.ego, picture.profile)
        with load_backend(picture.backend).open(
            scene.world, scene.air, picture.profile
        ) as renderer:
            renderer.place(replace(scene.frame, index=picture.frame_index))
            captures.append(renderer.render_camera(view))
    return captures


def compute_luminance(capture: CameraCapture) -> FloatArray:
    """Compute the luminance (h, w) of a capture, cd/m²."""
    return (capture.radiance @ LUMINANCE_WEIGHTS).astype(float)


def measure_noise(found: CameraCapture, reference: CameraCapture) -> str:
    """Measure the noise of a picture, as cells of a table."""
    expected = compute_luminance(reference)
    error = np.abs(compute_relative_error(compute_luminance(found), expected))
    kept = np.sort(error, axis=None)[: int(KEPT_FRACTION * error.size)]
    return f"{np.sqrt((kept**2).mean()):.1%} | {np.median(kept):.1%}"


def compute_relative_error(found: FloatArray, expected: FloatArray) -> FloatArray:
    """Compute errors relative to what is expected, of dark pixels to 1 % of the mean."""
    return (found - expected) / np.maximum(expected, 0.01 * expected.mean())


def measure_light(captures: Mapping[str, CameraCapture], goal: float) -> Iterator[str]:
    """Measure the light of Mitsuba's picture by class, as cells of rows of a table."""
    classes = [capture.semantic for capture in captures.values()]
    same: NDArray[np.bool_] = np.all([one == classes[0] for one in classes], axis=0)
    light = {name: compute_luminance(capture) for name, capture in captures.items()}
    judges = light["raster"], light["mitsuba"]
    for semantic in Semantic:
        where = same & (classes[0] == semantic)
        if np.count_nonzero(where) < LEAST_PIXELS:
            continue
        kept: NDArray[np.bool_] = np.all(
            [one[where] <= np.quantile(one[where], KEPT_FRACTION) for one in judges], axis=0
        )
        mean = {name: float(one[where][kept].mean()) for name, one in light.items()}
        ratio = mean["mitsuba"] / mean["raster"]
        missed = ", MISSED" if abs(ratio - 1.0) > goal else ""
        median = float(np.median(light["mitsuba"][where] / light["raster"][where]))
        cells = (
            f"{semantic.name.lower()} | {where.mean():.1%} | {mean['mitsuba']:.3g}",
            f"{ratio:.2f}{missed} | {median:.2f} | {compare_with_tracer(mean)}",
        )
        yield " | ".join(cells)


def compare_with_tracer(mean: Mapping[str, float]) -> str:
    """Compare means with that of SAPIEN's tracer, where there is one, as cells of a table."""
    if "traced" not in mean:
        return "- | -"
    return f"{mean['mitsuba'] / mean['traced']:.2f} | {mean['traced'] / mean['raster']:.2f}"


def measure(
    pool: ProcessPoolExecutor, spec: Path, scale: float, tracer: bool
) -> tuple[list[str], list[str]]:
    """Measure a scenario; returns rows of the table of noise, and of that of light."""
    full = RENDER_PROFILES["full"].with_scale(scale)
    raw = replace(full, denoise=False)
    many = replace(raw, samples=raw.samples * REFERENCE_FACTOR)
    wanted = [
        Picture("mitsuba", many),
        # With the random numbers of the reference, its first samples would be the same.
        Picture("mitsuba", raw, FRAME + 1),
        Picture("mitsuba", full, FRAME + 1),
        Picture("sapien", RENDER_PROFILES["preview"].with_scale(scale)),
    ]
    reference, few, denoised, raster = pool.submit(render, spec, wanted).result()
    captures = {"mitsuba": reference, "raster": raster}
    if tracer:
        # SAPIEN's two packs of shaders do not mix in a process.
        (captures["traced"],) = pool.submit(render, spec, [Picture("sapien", raw)]).result()
    noise = [
        f"| {spec.stem} | {name} | {measure_noise(found, reference)} |"
        for name, found in (("as traced", few), ("denoised", denoised))
    ]
    goal = GOAL_BY_NIGHT if read_spec(spec).weather.time == "night" else GOAL_BY_DAY
    return noise, [f"| {spec.stem} | {cells} |" for cells in measure_light(captures, goal)]


def main() -> None:
    """Measure both, and print tables in Markdown."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("specs", nargs="*", type=Path, default=SPECS, metavar="SPEC")
    parser.add_argument("--scale", type=float, default=0.1, help="of the authored image size")
    parser.add_argument("--no-tracer", action="store_true", help="leave out SAPIEN's tracer")
    arguments = parser.parse_args()
    light: list[str] = []
    with ProcessPoolExecutor(1, mp_context=get_context("spawn"), max_tasks_per_child=1) as pool:
        print("| scenario | picture | RMS error | median |\n|---|---|---|---|")
        for spec in arguments.specs:
            noise, found = measure(pool, spec, arguments.scale, not arguments.no_tracer)
            light += found
            print(*noise, sep="\n", flush=True)
    print(
        "\n| scenario | class | area | cd/m² | over raster | median | over traced | traced/raster |"
    )
    print("|---|---|---|---|---|---|---|---|")
    print(*light, sep="\n")


if __name__ == "__main__":
    main()

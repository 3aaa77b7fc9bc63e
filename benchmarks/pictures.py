"""How much of a picture is flat, and how dark its dark parts are: `python benchmarks/pictures.py`.

The ego's front camera on a clear day at five sites, 1920 pixels wide, from the raster pack as a run
writes it. A pixel is flat if the nine around it differ by one level of grey at most; of photographs
of streets by day 3 % to 24 % is. The darkest twentieth of a photograph is below a grey of 14 to 54.
"""

import argparse
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np

from advercity.compiler import read_spec
from advercity.geometry.arrays import Uint8Array
from advercity.pipeline.preparation import PreparedScenario, load_or_simulate_traffic
from advercity.pipeline.sensing import open_sensors
from advercity.pipeline.spec_models import find_missing_models
from advercity.rendering.backend import RENDER_PROFILES, load_backend

ROADS = ("ui", "unj", "ri", "rsnj", "rcnj")
FRAMES = (20, 60, 100)
WIDTH_PX = 1920
FLAT_GOAL, DARK_GOAL = 0.25, 50.0


def render_images(road: str) -> Iterator[tuple[int, Uint8Array]]:
    """Yield frames and images (h, w, 3) of a road's ego."""
    spec = read_spec(Path(f"compiled/{road}_clear_day_sparse.json"))
    traffic = load_or_simulate_traffic(spec)
    scale = WIDTH_PX / spec.ego.sensors.cameras[0].model.width_px
    prepared = PreparedScenario(
        spec,
        traffic,
        load_backend("sapien"),
        RENDER_PROFILES["preview"].with_scale(scale),
        frames=range(len(traffic.trace)),
        missing_models=find_missing_models(spec),
    )
    with open_sensors(prepared) as sensors:
        for index in FRAMES:
            yield index, sensors.capture_image(spec.ego, 0, index)


def measure_flat_fraction(grey: Uint8Array) -> float:
    """Measure the fraction of pixels (h, w) whose neighbourhood is even."""
    kernel = np.ones((3, 3), dtype=np.uint8)
    return float(np.mean(cv2.dilate(grey, kernel) - cv2.erode(grey, kernel) <= 1))


def main() -> None:
    """Print a row per picture, and the means."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("roads", nargs="*", default=list(ROADS))
    rows: list[tuple[float, float]] = []
    print("| site | frame | flat | darkest twentieth |\n|---|---|---|---|")
    for road in parser.parse_args().roads:
        for index, image in render_images(road):
            grey = cv2.cvtColor(image, cv2.COLOR_RGB2GRAY).astype(np.uint8)
            rows.append((measure_flat_fraction(grey), float(np.percentile(grey, 5))))
            print(f"| {road} | {index} | {rows[-1][0]:.2f} | {rows[-1][1]:.0f} |", flush=True)
    flat, dark = np.mean(rows, axis=0)
    print(f"| mean | | {flat:.2f} (goal {FLAT_GOAL}) | {dark:.0f} (goal {DARK_GOAL:.0f}) |")


if __name__ == "__main__":
    main()

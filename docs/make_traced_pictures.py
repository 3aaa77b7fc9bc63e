"""Renders pictures of Mitsuba at 1920x1080 and puts them into `docs/images/mitsuba_weathers.jpg`.

    python docs/make_traced_pictures.py FOLDER [SITE_WEATHER ...]

Frame 40 of the ego's front camera, 16 samples, denoised. Pictures are written to FOLDER as PNG, and
those that are there are not rendered again. A place of the sheet whose picture is not named keeps
what it shows; without names it is all of them, a minute of two cores each:

    python docs/make_traced_pictures.py pictures ri_clear_night rsnj_clear_night rcnj_clear_night
"""

import argparse
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from advercity.compiler import read_spec
from advercity.media import draw_label_bar
from advercity.pipeline.preparation import PreparedScenario, load_or_simulate_traffic
from advercity.pipeline.sensing import open_sensors
from advercity.rendering.backend import RENDER_PROFILES, load_backend

ROOT = Path(__file__).parents[1]
SHEET = ROOT / "docs/images/mitsuba_weathers.jpg"
SITES = "ui", "unj", "ri", "rsnj", "rcnj"
WEATHERS = "clear_day", "heavy_rain_day", "fog_day", "clear_night"
FRAME = 40
TILE_PX = 288, 162
BAR_PX = len(draw_label_bar("", TILE_PX[0]))
JPEG_QUALITY = 90

Image = NDArray[np.uint8]


def main() -> None:
    """Render the named pictures, or all, and draw the sheet."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    every = [f"{site}_{weather}" for weather in WEATHERS for site in SITES]
    parser.add_argument("names", nargs="*", default=every, metavar="SITE_WEATHER")
    options = parser.parse_args()
    if unknown := set(options.names) - set(every):
        parser.error(f"no such picture: {', '.join(sorted(unknown))}")
    options.folder.mkdir(parents=True, exist_ok=True)
    pictures = {name: load_or_render(name, options.folder) for name in options.names}
    sheet = draw_sheet(pictures, np.asarray(cv2.imread(str(SHEET)), np.uint8))
    cv2.imwrite(str(SHEET), sheet, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])


def load_or_render(name: str, folder: Path) -> Image:
    """Read the picture (h, w, 3), BGR, of a site and weather, or render it."""
    path = folder / f"{name}.png"
    if not path.exists():
        cv2.imwrite(str(path), render(name)[..., ::-1])
    return np.asarray(cv2.imread(str(path)), np.uint8)


def render(name: str) -> Image:
    """Render a picture (h, w, 3) as a run would write it."""
    spec = read_spec(ROOT / f"compiled/{name}_sparse.json")
    prepared = PreparedScenario(
        spec,
        load_or_simulate_traffic(spec),
        load_backend("mitsuba"),
        RENDER_PROFILES["full"],
        frames=range(FRAME, FRAME + 1),
    )
    with open_sensors(prepared) as sensors:
        return sensors.capture_image(spec.agents[0], 0, FRAME)


def draw_sheet(pictures: dict[str, Image], former: Image) -> Image:
    """Draw a column of pictures (h, w, 3) by name for each site, and the former ones besides."""
    width, height = TILE_PX
    columns: list[Image] = []
    for place, site in enumerate(SITES):
        column = [draw_label_bar(site, width)]
        for number, weather in enumerate(WEATHERS):
            column.append(draw_label_bar(weather, width))
            top = BAR_PX + number * (BAR_PX + height) + BAR_PX
            picture = pictures.get(f"{site}_{weather}")
            if picture is not None:
                tile = cv2.resize(picture, TILE_PX, interpolation=cv2.INTER_AREA)
            else:
                tile = former[top : top + height, place * width : (place + 1) * width]
            column.append(np.asarray(tile, np.uint8))
        columns.append(np.vstack(column))
    return np.hstack(columns)


if __name__ == "__main__":
    main()

"""Makes the contact sheets of docs/bodies.md with the models that are installed.

python docs/make_body_pictures.py [FOLDER]
"""

import sys
from pathlib import Path

import cv2
import numpy as np

from advercity.rendering.registry import load_backend
from advercity.runner.bodies import catalogue_blueprints
from advercity.runner.body_sheet import body_sheet
from advercity.runner.cache import shelf

SHEETS = {
    "cars": ("car",),
    "vans_and_trucks": ("van", "truck"),
    "two_wheelers": ("bicycle", "motorcycle"),
    "people": ("pedestrian",),
}
SCALE = 0.5
JPEG_QUALITY = 76


def main() -> None:
    """Write a sheet for each group of classes."""
    home = Path(__file__).parent / "images/bodies"
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else home
    folder.mkdir(parents=True, exist_ok=True)
    backend = load_backend("sapien")
    for name, classes in SHEETS.items():
        some = {
            key: made for key, made in catalogue_blueprints().items() if made.actor_class in classes
        }
        sheet = body_sheet(some, backend, shelf())
        small = cv2.resize(sheet, None, fx=SCALE, fy=SCALE, interpolation=cv2.INTER_AREA)
        options = [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY]
        _, content = cv2.imencode(".jpg", small.astype(np.uint8), options)
        (folder / f"{name}.jpg").write_bytes(content.tobytes())


if __name__ == "__main__":
    main()

"""Renders the contact sheets of docs/bodies.md with the installed models.

python docs/make_body_pictures.py [FOLDER]
"""

import sys
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
from advercity_dsl import Blueprint

from advercity.assets.catalogue import load_catalogue_blueprints
from advercity.assets.model_store import open_model_store
from advercity.pipeline.body_sheet import draw_body_sheet
from advercity.rendering.backend import load_backend


def has_attachment(item: Blueprint) -> bool:
    """Return whether a pedestrian has a pram, a dog or a wheelchair."""
    return item.looks is not None and item.looks.attachment != "none"


SHEETS: dict[str, Callable[[Blueprint], bool]] = {
    "cars": lambda item: item.actor_class == "car",
    "vans_and_trucks": lambda item: item.actor_class in ("van", "truck"),
    "two_wheelers": lambda item: item.actor_class in ("bicycle", "motorcycle"),
    "people": lambda item: item.actor_class == "pedestrian" and not has_attachment(item),
    "attachments": has_attachment,
}
SCALE = 0.5
JPEG_QUALITY = 76


def main() -> None:
    """Write a sheet for each group."""
    home = Path(__file__).parent / "images/bodies"
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else home
    folder.mkdir(parents=True, exist_ok=True)
    backend = load_backend("sapien")
    for name, is_shown in SHEETS.items():
        blueprints = {
            key: blueprint
            for key, blueprint in load_catalogue_blueprints().items()
            if is_shown(blueprint)
        }
        sheet = draw_body_sheet(blueprints, backend, open_model_store())
        small = cv2.resize(sheet, None, fx=SCALE, fy=SCALE, interpolation=cv2.INTER_AREA)
        options = [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY]
        _, content = cv2.imencode(".jpg", small.astype(np.uint8), options)
        (folder / f"{name}.jpg").write_bytes(content.tobytes())


if __name__ == "__main__":
    main()

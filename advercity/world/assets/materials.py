"""What the materials of foreign models stand for here, told from their names."""

import re
from collections.abc import Iterator, Mapping

import numpy as np
from advercity_dsl.catalogue import Part
from numpy.typing import NDArray

from advercity.world.assets import wavefront
from advercity.world.materials import PAINT

MATERIAL_OF: dict[Part, str] = {
    "paint": PAINT,
    "white_paint": "car_paint_white",
    "black_paint": "car_paint_black",
    "red_paint": "car_paint_red",
    "blue_paint": "car_paint_blue",
    "glass": "glass",
    "rubber": "rubber",
    "chrome": "chrome",
    "metal": "metal",
    "plastic": "black_plastic",
    "interior": "upholstery",
    "plate": "licence_plate",
    "headlamp": "lamp_white",
    "tail_lamp": "lamp_red",
    "indicator": "lamp_amber",
}
"""Key of MATERIALS of every part that is kept."""

_TOLD: tuple[tuple[str, Part], ...] = (
    (r"tail|brake.?light|rear.?light|back.?light|red.?light|glass_red", "tail_lamp"),
    (r"turn|indicator|blinker|orange.?light", "indicator"),
    (r"head.?l|front.?light|focus|reflector|parking_light|lamp", "headlamp"),
    (r"licen[sc]e|plate|number", "plate"),
    (r"glass|window|crystal|windscreen|windshield", "glass"),
    (r"tire|tyre|rubber", "rubber"),
    (r"interior|seat|inside|steering|floor|upholst", "interior"),
    (r"chrome|mirror|alumin", "chrome"),
    (r"paint|first.?colou?r|exterior|body|shell", "paint"),
    (r"wheel|rim|metal|steel", "metal"),
)


def part_of(name: str, declared: Mapping[str, Part]) -> Part:
    """What a material stands for: as declared, else as its name tells, else plastic."""
    if name in declared:
        return declared[name]
    lower = name.lower()
    return next((part for pattern, part in _TOLD if re.search(pattern, lower)), "plastic")


def by_colour(part: wavefront.Part) -> Iterator[tuple[str, NDArray[np.int64]]]:
    """Materials, and which triangles are of them, of a part that one texture paints all over.

    Such a part holds what is neither bodywork nor window: red glasses at the back are tail lamps,
    light ones at the front headlamps, other light spots are metal, dark ones plastic.
    """
    if part.colours is None:
        yield MATERIAL_OF["plastic"], part.triangles
        return
    x = part.vertices[part.triangles][:, :, 0].mean(axis=1)
    middle, half = (x.max() + x.min()) / 2, max(float(np.ptp(x)) / 2, 1e-9)
    along = (x - middle) / half
    red, green, blue = part.colours.T
    bright = part.colours.mean(axis=1)
    is_red = (red > 0.3) & (red > 1.8 * green) & (red > 1.8 * blue)
    is_amber = (red > 0.5) & (green > 0.25) & (blue < 0.45 * red) & ~is_red
    kinds = np.select(
        [
            is_red & (along < 0.0),
            is_amber & (np.abs(along) > 0.6),
            (bright > 0.45) & (along > 0.7),
            bright > 0.3,
        ],
        [1, 2, 3, 4],
    )
    names: tuple[Part, ...] = ("plastic", "tail_lamp", "indicator", "headlamp", "metal")
    for kind, name in enumerate(names):
        if (kinds == kind).any():
            yield MATERIAL_OF[name], part.triangles[kinds == kind]

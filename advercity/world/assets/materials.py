"""What the materials of foreign models stand for here, told from their names."""

import re
from collections.abc import Mapping

import numpy as np
from advercity_dsl.catalogue import Part
from numpy.typing import NDArray

from advercity.world.assets import wavefront
from advercity.world.materials import PAINT

LENSES = frozenset({"glass", "headlamp", "tail_lamp"})
"""Parts whose place on the body says what they really are."""
MATERIAL_OF: dict[str, str] = {
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
    for pattern, part in _TOLD:
        if re.search(pattern, name.lower()):
            return part
    return "plastic"


def by_colour(part: wavefront.Part) -> NDArray[np.str_]:
    """What each triangle (m,) of a part stands for that one texture paints all over.

    Such a part holds what is neither bodywork nor window: lamps, plates, trim, the rims of wheels,
    which alone face sideways.
    """
    if part.colours is None:
        return np.full(len(part.triangles), "plastic")
    red, green, blue = part.colours.T
    is_red = (red > 0.3) & (red > 1.8 * green) & (red > 1.8 * blue)
    is_amber = (red > 0.5) & (green > 0.25) & (blue < 0.45 * red) & ~is_red
    is_light = part.colours.mean(axis=1) > 0.45
    corners = part.vertices[part.triangles]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    is_rim = np.abs(normal[:, 1]) > 0.85 * np.linalg.norm(normal, axis=1)
    is_lamp = is_light & ~is_rim & (corners[:, :, 0].mean(axis=1) > 0.0)
    kinds = [is_red & ~is_rim, is_amber, is_lamp, part.colours.mean(axis=1) > 0.3]
    return np.select(kinds, ["tail_lamp", "indicator", "headlamp", "metal"], "plastic")


def at_their_places(
    stands_for: NDArray[np.str_], part: wavefront.Part, size: tuple[float, float, float]
) -> NDArray[np.str_]:
    """What triangles (m,) stand for once it counts where on a body of this size they are.

    White lamps are at the front, to the sides; red ones are at the back; and low panes at either
    end are the covers of lamps.
    """
    middle = np.abs(part.vertices[part.triangles].mean(axis=1)) / np.maximum(size, 1e-9)
    along = part.vertices[part.triangles].mean(axis=1)[:, 0] / size[0]
    across, height = middle[:, 1], middle[:, 2]
    is_cover = (stands_for == "glass") & (np.abs(along) > 0.36) & (height < 0.5)
    lamp = np.where(along > 0.0, "headlamp", "tail_lamp")
    placed = np.where(is_cover | (stands_for == "headlamp"), lamp, stands_for)
    is_white = (placed == "headlamp") & (along > 0.2) & (across > 0.18) & (height < 0.65)
    is_red = (placed == "tail_lamp") & (along < -0.2)
    placed = np.where((placed == "headlamp") & ~is_white, "metal", placed)
    return np.where((placed == "tail_lamp") & ~is_red, "plastic", placed)

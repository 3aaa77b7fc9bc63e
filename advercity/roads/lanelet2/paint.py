"""Painted lines of a Lanelet2 map."""

from collections.abc import Iterator, Mapping

import numpy as np
from advercity_dsl.road import RoadMark

from advercity.geometry.polyline import Points, offset_polyline
from advercity.roads.lanelet2.document import LaneletDocument

STRIPE_OFFSETS_M: Mapping[tuple[str, int], tuple[float, ...]] = {
    ("line_thin", 1): (0.0,),
    ("line_thick", 1): (0.06, -0.06),
    ("line_thin", 2): (0.12, -0.12),
    ("line_thick", 2): (0.18, 0.06, -0.06, -0.18),
}
"""Distances to the left of stripes 0.12 m wide, by type of a line and number of its lines."""
MIN_STEP_M = 1e-3
"""Closer points of a line in the plan have no direction."""
MARKS: Mapping[tuple[str, bool], RoadMark] = {
    ("solid", False): RoadMark.SOLID_WHITE,
    ("dashed", False): RoadMark.BROKEN_WHITE,
    ("solid", True): RoadMark.SOLID_YELLOW,
    ("dashed", True): RoadMark.BROKEN_YELLOW,
}
"""Marks by style and whether they are yellow."""


def list_stripes(
    document: LaneletDocument, points: Mapping[str, Points]
) -> Iterator[tuple[RoadMark, Points]]:
    """List the stripes (n, 3) of all painted lines; `dashed_solid` is dashed on its left."""
    for way in document.ways.values():
        styles = way.tags.get("subtype", "").split("_")
        offsets = STRIPE_OFFSETS_M.get((way.tags.get("type", ""), len(styles)), ())
        if not set(styles) <= {"solid", "dashed"}:
            continue
        is_yellow = way.tags.get("color") == "yellow"
        line = np.array([points[node] for node in way.nodes if node in points]).reshape(-1, 3)
        steps_m = np.linalg.norm(np.diff(line[:, :2], axis=0), axis=1)
        line = line[np.concatenate([[True], steps_m > MIN_STEP_M])[: len(line)]]
        if len(line) < 2:
            continue
        for index, aside_m in enumerate(offsets):
            style = styles[index * len(styles) // len(offsets)]
            yield MARKS[style, is_yellow], offset_polyline(line, aside_m)

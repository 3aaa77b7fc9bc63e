"""Lanes of a road as annotations and maps need them."""

from collections import Counter
from collections.abc import Iterator

import numpy as np
from advercity_dsl.road import StripKind

from advercity import curves
from advercity.streets import StreetLayout
from advercity.world.edges import edge_id
from advercity.world.junctions import CrossingLayout
from advercity.world.layout import Layout
from advercity.world.scene import Lane

KINDS = {
    StripKind.LANE: "driving",
    StripKind.PARKING: "parking",
    StripKind.SHOULDER: "shoulder",
    StripKind.SIDEWALK: "sidewalk",
}


def lanes(layout: Layout) -> tuple[Lane, ...]:
    """Every lane of a road, then the ways and crossings of its junctions.

    Driving lanes are `<street>+.<number>` or `<street>-.<number>`, other strips have their kind
    before the number (`<street>+.sidewalk1`); all count from the axis. Ways are
    `<junction>: <movement>`, crossings `<junction>/<street>`.
    """
    found = [lane for street in layout.streets.values() for lane in _of_street(street)]
    for junction in layout.junctions.values():
        found += [
            Lane(path.id, "driving", path.left, path.right, in_junction=True)
            for path in junction.paths
        ]
        found += [_of_crossing(junction.id, crossing) for crossing in junction.crossings]
    return tuple(found)


def _of_street(street: StreetLayout) -> Iterator[Lane]:
    for along in (True, False):
        seen: Counter[str] = Counter()
        for band in street.side(along=along):
            if band.kind in KINDS:
                kind = KINDS[band.kind]
                seen[kind] += 1
                name = band.number if band.number else f"{kind}{seen[kind]}"
                yield Lane(
                    id=f"{edge_id(street.id, along=along)}.{name}",
                    kind=kind,
                    left=street.travelled(band.inner_t, along=along),
                    right=street.travelled(band.outer_t, along=along),
                )


def _of_crossing(junction: str, crossing: CrossingLayout) -> Lane:
    start, end = crossing.centre
    direction = (end - start)[:2] / np.linalg.norm((end - start)[:2])
    aside = np.array([*curves.left_of(direction), 0.0]) * crossing.width_m / 2
    return Lane(
        id=f"{junction}/{crossing.street}",
        kind="crossing",
        left=crossing.centre + aside,
        right=crossing.centre - aside,
        in_junction=True,
    )

"""Where lanes and roadway end beside a way, as offsets to the left of the lane's centre."""

from advercity_dsl.road import StripKind

from advercity.compiler.ways import Stretch


def outer_edge(stretch: Stretch, *, right: bool, to_median: bool = True) -> float:
    """Offset, in metres, of the outer edge of the lanes on a side.

    Args:
        stretch: The street.
        right: On which side.
        to_median: Whether to the left a median counts as the edge.
    """
    own = stretch.bands(right=True)
    if right:
        return stretch.lateral([b for b in own if b.kind is StripKind.LANE][-1].outer_t)
    if to_median and any(band.kind is StripKind.MEDIAN for band in own):
        return stretch.lateral(next(b for b in own if b.kind is StripKind.LANE).inner_t)
    other = [b for b in stretch.bands(right=False) if b.kind is StripKind.LANE]
    return stretch.lateral(other[-1].outer_t) if other else stretch.lateral(0.0)


def riding_line(stretch: Stretch) -> float:
    """Offset, in metres, of where one rides at the right edge.

    In the middle of the shoulder or parking lane, else just beside the lanes.
    """
    bands = stretch.bands(right=True)
    last = max(index for index, band in enumerate(bands) if band.kind is StripKind.LANE)
    beside = bands[last + 1] if last + 1 < len(bands) else None
    if beside and beside.kind in (StripKind.SHOULDER, StripKind.PARKING) and beside.width_m > 1:
        return stretch.lateral(beside.centre_t)
    return stretch.lateral(bands[last].outer_t) - 0.25

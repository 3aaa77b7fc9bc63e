"""Forms of cars: the cage of points under the smooth surface of each kind of car.

A station is the distance from the nose as a fraction of the length; heights are fractions of the
height unless their names end in `_m`, widths are fractions of half of the width.
"""

from dataclasses import dataclass

import numpy as np

from advercity.geometry.arrays import Float64Array


@dataclass(frozen=True)
class CarForm:
    """Side view and widths of a kind of car."""

    axles: tuple[float, float]
    wheel_m: float
    clearance_m: float
    bonnet: tuple[float, float, float]
    """Heights of its front edge, its middle and its rear end."""
    belt: tuple[float, float]
    """Heights of the lower edge of the side windows, in front and behind."""
    cabin: tuple[float, float, float, float]
    """Stations of foot and top of the windscreen, then of top and foot of the rear window."""
    roof: tuple[float, float, float]
    """Heights of the roof over the windscreen, at its highest, and over the rear window."""
    boot: tuple[float, float, float]
    """Heights at the foot of the rear window, of the boot, and of its rear edge."""
    rear_screen: float
    """Height of the middle of the rear window's centre line."""
    pillar: float
    """Station of the B-pillar, between the doors."""
    roof_width: float = 0.76
    nose_rake: float = 1.0
    """How far the top of the nose is behind the bumper, relative to a saloon."""
    tail_rake: float = 1.0
    side_windows: tuple[bool, ...] = (True, True)
    """Side windows from the front, behind and ahead of the B-pillar; a panel van lacks some."""
    is_rugged: bool = False
    """Whether it has roof rails, and black sills and wheel arches."""
    squareness: float = 0.0
    """How square its corners are and how upright its sides, from a car's (0) to a box's (1)."""
    is_cab: bool = False
    """Whether it is the cab of a truck, with its doors over the front wheels."""
    headlamp_rows: tuple[float, float] = (3.9, 5.55)
    grille_rows: tuple[float, float] = (3.9, 5.05)
    plate_row: float = 2.95
    """Rows of the cage between which lamps and grille are, and where the front plate is."""


SALOON = CarForm(
    axles=(0.185, 0.775), wheel_m=0.325, clearance_m=0.17,
    bonnet=(0.50, 0.585, 0.645), belt=(0.625, 0.665),
    cabin=(0.27, 0.435, 0.67, 0.82), roof=(0.955, 1.0, 0.95),
    boot=(0.725, 0.715, 0.695), rear_screen=0.83, pillar=0.53,
)  # fmt: skip
ESTATE = CarForm(
    axles=(0.185, 0.77), wheel_m=0.325, clearance_m=0.17,
    bonnet=(0.50, 0.585, 0.64), belt=(0.62, 0.65),
    cabin=(0.265, 0.42, 0.885, 0.965), roof=(0.95, 1.0, 0.945),
    boot=(0.66, 0.62, 0.58), rear_screen=0.82, pillar=0.52, roof_width=0.79, tail_rake=0.6,
)  # fmt: skip
HATCHBACK = CarForm(
    axles=(0.19, 0.815), wheel_m=0.305, clearance_m=0.16,
    bonnet=(0.50, 0.575, 0.635), belt=(0.62, 0.665),
    cabin=(0.235, 0.43, 0.85, 0.955), roof=(0.945, 1.0, 0.95),
    boot=(0.68, 0.63, 0.58), rear_screen=0.83, pillar=0.55, roof_width=0.79, tail_rake=0.6,
)  # fmt: skip
SUV = CarForm(
    axles=(0.185, 0.79), wheel_m=0.37, clearance_m=0.22,
    bonnet=(0.545, 0.60, 0.63), belt=(0.61, 0.64),
    cabin=(0.265, 0.395, 0.885, 0.955), roof=(0.95, 0.985, 0.955),
    boot=(0.65, 0.61, 0.57), rear_screen=0.82, pillar=0.515, roof_width=0.82,
    nose_rake=0.5, tail_rake=0.5, is_rugged=True,
)  # fmt: skip
SPORTS = CarForm(
    axles=(0.19, 0.785), wheel_m=0.335, clearance_m=0.13,
    bonnet=(0.50, 0.60, 0.67), belt=(0.655, 0.70),
    cabin=(0.32, 0.485, 0.66, 0.875), roof=(0.95, 1.0, 0.965),
    boot=(0.76, 0.745, 0.72), rear_screen=0.88, pillar=0.60, roof_width=0.73, nose_rake=1.3,
)  # fmt: skip
MINIBUS = CarForm(
    axles=(0.19, 0.76), wheel_m=0.32, clearance_m=0.19,
    bonnet=(0.46, 0.505, 0.535), belt=(0.52, 0.53),
    cabin=(0.07, 0.20, 0.945, 0.98), roof=(0.955, 0.995, 0.965),
    boot=(0.53, 0.48, 0.44), rear_screen=0.76, pillar=0.36, roof_width=0.86,
    nose_rake=0.7, tail_rake=0.3,
)  # fmt: skip
PANEL_VAN = CarForm(
    axles=(0.165, 0.785), wheel_m=0.345, clearance_m=0.19,
    bonnet=(0.355, 0.42, 0.475), belt=(0.45, 0.47),
    cabin=(0.145, 0.275, 0.955, 0.985), roof=(0.945, 0.99, 0.975),
    boot=(0.47, 0.43, 0.40), rear_screen=0.72, pillar=0.35, roof_width=0.87,
    nose_rake=0.6, tail_rake=0.2, side_windows=(True, False),
)  # fmt: skip
CAB = CarForm(
    axles=(0.55, 9.0), wheel_m=0.45, clearance_m=0.40,
    bonnet=(0.525, 0.545, 0.56), belt=(0.555, 0.56),
    cabin=(0.075, 0.18, 0.98, 0.99), roof=(0.95, 0.995, 0.985),
    boot=(0.60, 0.56, 0.53), rear_screen=0.82, pillar=0.70, roof_width=0.95,
    nose_rake=0.3, tail_rake=0.1, side_windows=(True, False), squareness=0.7, is_cab=True,
    headlamp_rows=(2.35, 3.3), grille_rows=(3.1, 5.05), plate_row=1.75,
)  # fmt: skip


def choose_car_form(length_m: float, height_m: float) -> CarForm:
    """Choose the kind of car for a box of this length and height."""
    slenderness = height_m / length_m
    if height_m >= 1.60 and slenderness >= 0.335:
        return SUV
    if length_m < 4.0 or slenderness >= 0.35:
        return HATCHBACK
    if height_m >= 1.60:
        return ESTATE
    return SPORTS if height_m < 1.42 and length_m < 4.9 else SALOON


COLUMN_COUNT = 21
"""Columns of the cage from nose to tail; its rows go from the floor's edge to the roof's centre."""
SILL, SHOULDER, BELT, CENTRE = 1, 4, 6, 10
"""Rows of lower edge, shoulder, foot and top of the side windows, and the centre line."""
COWL, HEADER, REAR_HEADER, REAR_FOOT = 7, 9, 13, 15
"""Columns of foot and top of the windscreen, and of top and foot of the rear window."""
_FLANK_HEIGHTS = np.array([0.0, 0.0, 0.14, 0.42, 0.74, 0.93, 1.0])
"""Heights of the rows up to the belt, between lower edge and belt line."""
_FLANK_WIDTHS = np.array([0.62, 0.955, 0.99, 1.0, 0.985, 0.955, 0.915])
_BONNET_WIDTHS = np.array([0.84, 0.66, 0.36, 0.0])
_BONNET_HEIGHTS = np.array([0.45, 0.80, 0.97, 1.0])
_ROOF_WIDTHS = np.array([1.0, 0.90, 0.50, 0.0])
_ROOF_DROPS = np.array([0.052, 0.016, 0.003, 0.0])
_END_WIDTHS = (0.0, 0.50, 0.83, 0.955)
_NOSE_SETBACK = np.array(
    [0.030, 0.012, 0.002, 0.0, 0.007, 0.014, 0.017, 0.020, 0.024, 0.027, 0.028]
)
_TAIL_SETBACK = np.array(
    [0.030, 0.012, 0.002, 0.0, 0.004, 0.010, 0.012, 0.016, 0.018, 0.020, 0.021]
)
_END_BOW = np.array([0.0, 0.005, 0.020, 0.060])
"""Distances of an end's corners behind its middle, as stations."""


def build_car_cage(form: CarForm, length_m: float, half_m: float, height_m: float) -> Float64Array:
    """Build the cage (columns, rows, 3) of the left half of a car, metres, x forward."""
    station = _compute_stations(form)
    cowl, _, _, foot = form.cabin
    centre = np.array(_compute_centre_line(form))
    belt = np.interp(station, [cowl, foot], form.belt)
    on_bonnet, on_boot = np.arange(COLUMN_COUNT) <= COWL - 1, np.arange(COLUMN_COUNT) > REAR_FOOT
    top = np.where(on_bonnet | on_boot, np.minimum(centre - 0.035, belt), belt)
    bottom = form.clearance_m / height_m + np.interp(
        station, [0, 0.06, 0.93, 1], [0.04, 0, 0, 0.06]
    )
    width = np.interp(
        station, [0.03, 0.10, 0.22, 0.78, 0.92, 0.98], [0.93, 0.975, 1, 1, 0.975, 0.94]
    )
    width[:4], width[-4:] = _END_WIDTHS, _END_WIDTHS[::-1]
    width[width > 0.8] = _square(width[width > 0.8], form)
    roofed = _compute_roof_fraction()[:, None]
    flank = bottom[:, None] + _FLANK_HEIGHTS * (top - bottom)[:, None]
    low = top[:, None] + _BONNET_HEIGHTS * (centre - top)[:, None]
    drops = (1.0 - form.squareness / 2) * _ROOF_DROPS
    high = centre[:, None] - drops * np.minimum(1.0, (centre - top) / 0.2)[:, None]
    upper = (1 - roofed) * low + roofed * high
    roof_widths = _ROOF_WIDTHS.copy()
    roof_widths[:2] = _square(roof_widths[:2], form)
    across = (1 - roofed) * _BONNET_WIDTHS + roofed * form.roof_width * roof_widths
    flanks = _FLANK_WIDTHS.copy()
    flanks[SILL:] = _square(flanks[SILL:], form)
    y = width[:, None] * np.hstack([np.broadcast_to(flanks, flank.shape), across])
    x = np.broadcast_to(station[:, None], y.shape).copy()
    near = np.clip(1.0 - np.abs(station - np.round(station)) / 0.10, 0.0, 1.0)[:, None]
    x += np.where(station < 0.5, 1, 0)[:, None] * near * form.nose_rake * _NOSE_SETBACK
    x -= np.where(station < 0.5, 0, 1)[:, None] * near * form.tail_rake * _TAIL_SETBACK
    # Windscreens bow forward, rear windows backward.
    x[COWL : HEADER + 1] += 0.03 * (y[COWL : HEADER + 1] ** 2) - 0.012
    x[REAR_HEADER : REAR_FOOT + 1] -= 0.018 * (y[REAR_HEADER : REAR_FOOT + 1] ** 2) - 0.008
    z = np.hstack([flank, upper])
    return np.stack([length_m * (0.5 - x), half_m * y, height_m * z], axis=-1)


def _square(widths: Float64Array, form: CarForm) -> Float64Array:
    """Widen a form's values within its full width of 1."""
    return widths + form.squareness * (1.0 - widths)


def _compute_stations(form: CarForm) -> Float64Array:
    bow = (1.0 - form.squareness / 2) * _END_BOW
    cowl, header, back, foot = form.cabin
    ahead = np.minimum(np.array([0.11, 0.185]), np.array([0.45, 0.8]) * cowl)
    ahead = np.maximum(ahead, [0.062, 0.066])
    behind = max(foot + 0.004, min(0.94, foot + 0.05))
    roof = back - header
    tail = min(1.0, (0.997 - behind) / bow[-1])
    return np.array(
        [
            *bow,
            *ahead,
            max(cowl - 0.035, ahead[1] + 0.002),
            cowl,
            (cowl + header) / 2,
            header,
            *(header + roof * np.array([0.18, 0.5, 0.82])),
            back,
            (back + foot) / 2,
            foot,
            behind,
            *(1 - tail * bow[::-1]),
        ]
    )


def _compute_centre_line(form: CarForm) -> list[float]:
    front, middle, rear = form.bonnet
    first, peak, last = form.roof
    screen = 0.5 * (rear + first) + 0.012
    boot = form.boot
    return [
        *(front - 0.01, front, front, front + 0.01, (front + middle) / 2 + 0.01, middle),
        *(rear - 0.012, rear, screen, first),
        *((first + peak) / 2 + 0.008, peak, (peak + last) / 2 + 0.008),
        *(last, form.rear_screen, boot[0], boot[1]),
        *(boot[2], boot[2] - 0.005, boot[2] - 0.01, boot[2] - 0.01),
    ]


def _compute_roof_fraction() -> Float64Array:
    """Compute for each column how far its upper rows belong to a roof, not to a bonnet."""
    at = [
        COWL - 1,
        COWL,
        HEADER - 1,
        HEADER,
        REAR_HEADER,
        REAR_HEADER + 1,
        REAR_FOOT,
        REAR_FOOT + 1,
    ]
    return np.interp(np.arange(COLUMN_COUNT), at, [0, 0.12, 0.62, 1, 1, 0.62, 0.12, 0])

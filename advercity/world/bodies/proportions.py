"""Side views of motor cars, by kind.

A `station` is the share of a car's length from the nose; heights are shares of its height.
"""

from dataclasses import dataclass

Table = tuple[tuple[float, float], ...]


@dataclass(frozen=True)
class Proportions:
    """Side view of a kind of car."""

    deck: Table
    """Height of bonnet, belt and boot by station."""
    axles: tuple[float, float]
    wheel_m: float
    clearance_m: float
    cabin: tuple[float, float, float, float]
    """Stations of windscreen foot, windscreen top, rear window top and its foot."""
    pillar: float
    """Station of the pillar between the doors."""
    roof_width: float
    """Width of the roof as a share of the widest."""
    windows: int = 2
    """Side windows, counted from the front; a panel van has one."""
    rails: bool = False
    """Whether its roof has some."""


_SALOON = Proportions(
    deck=(
        (0, 0.40),
        (0.012, 0.46),
        (0.05, 0.52),
        (0.14, 0.575),
        (0.27, 0.63),
        (0.6, 0.645),
        (0.84, 0.665),
        (0.95, 0.665),
        (0.985, 0.62),
        (1, 0.56),
    ),
    axles=(0.195, 0.775),
    wheel_m=0.33,
    clearance_m=0.17,
    cabin=(0.255, 0.42, 0.70, 0.875),
    pillar=0.53,
    roof_width=0.76,
)
_HATCHBACK = Proportions(
    deck=(
        (0, 0.38),
        (0.015, 0.45),
        (0.06, 0.53),
        (0.16, 0.60),
        (0.25, 0.635),
        (0.6, 0.655),
        (0.93, 0.675),
        (0.985, 0.63),
        (1, 0.50),
    ),
    axles=(0.19, 0.82),
    wheel_m=0.31,
    clearance_m=0.17,
    cabin=(0.215, 0.41, 0.87, 0.965),
    pillar=0.56,
    roof_width=0.79,
)
_SUV = Proportions(
    deck=(
        (0, 0.42),
        (0.012, 0.50),
        (0.05, 0.56),
        (0.15, 0.585),
        (0.26, 0.61),
        (0.6, 0.62),
        (0.95, 0.63),
        (0.985, 0.60),
        (1, 0.48),
    ),
    axles=(0.185, 0.79),
    wheel_m=0.37,
    clearance_m=0.23,
    cabin=(0.25, 0.36, 0.91, 0.975),
    pillar=0.52,
    roof_width=0.83,
    rails=True,
)
_SPORTS = Proportions(
    deck=(
        (0, 0.40),
        (0.015, 0.47),
        (0.06, 0.54),
        (0.16, 0.60),
        (0.33, 0.665),
        (0.62, 0.68),
        (0.84, 0.71),
        (0.955, 0.69),
        (0.988, 0.63),
        (1, 0.54),
    ),
    axles=(0.19, 0.785),
    wheel_m=0.335,
    clearance_m=0.13,
    cabin=(0.32, 0.47, 0.66, 0.88),
    pillar=0.585,
    roof_width=0.73,
)
MINIBUS = Proportions(
    deck=((0, 0.38), (0.012, 0.46), (0.035, 0.52), (0.2, 0.535), (0.96, 0.535), (1, 0.46)),
    axles=(0.20, 0.76),
    wheel_m=0.32,
    clearance_m=0.2,
    cabin=(0.035, 0.12, 0.945, 0.98),
    pillar=0.34,
    roof_width=0.86,
)
PANEL_VAN = Proportions(
    deck=(
        (0, 0.27),
        (0.012, 0.32),
        (0.05, 0.375),
        (0.13, 0.43),
        (0.18, 0.45),
        (0.97, 0.46),
        (1, 0.40),
    ),
    axles=(0.165, 0.79),
    wheel_m=0.34,
    clearance_m=0.2,
    cabin=(0.135, 0.255, 0.965, 0.985),
    pillar=0.36,
    roof_width=0.87,
    windows=1,
)


def proportions(length_m: float, height_m: float) -> Proportions:
    """Which kind of car a box of this length and height holds."""
    slenderness = height_m / length_m
    if height_m >= 1.64 and slenderness >= 0.335:
        return _SUV
    if length_m < 4.0 or slenderness >= 0.35:
        return _HATCHBACK
    if height_m < 1.42 and length_m < 4.9:
        return _SPORTS
    return _SALOON

"""Transitions from one value to another, by time, distance or rate."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from xml.etree.ElementTree import Element

from advercity.recordings.openscenario.document import Scope


@dataclass(frozen=True)
class Shape:
    """A way from 0 to 1, and the largest slope on it.

    Attributes:
        blend: Value by share of the way.
        peak_slope: Largest slope, the meaning of a rate.
        peak_curvature: Largest second derivative; infinite where the slope jumps.
    """

    blend: Callable[[float], float]
    peak_slope: float
    peak_curvature: float


SHAPES: Mapping[str, Shape] = {
    "step": Shape(lambda share: 1.0, math.inf, math.inf),
    "linear": Shape(lambda share: share, 1.0, math.inf),
    "sinusoidal": Shape(
        lambda share: (1 - math.cos(math.pi * share)) / 2, math.pi / 2, math.pi**2 / 2
    ),
    "cubic": Shape(lambda share: share**2 * (3 - 2 * share), 1.5, 6.0),
}
DIMENSIONS = ("time", "distance", "rate")


@dataclass(frozen=True)
class Dynamics:
    """How a value changes: `TransitionDynamics`."""

    shape: Shape
    dimension: str
    value: float

    def measure(self, change: float) -> tuple[float, bool]:
        """Return the time or distance of a change, and whether it is a distance."""
        if math.isinf(self.shape.peak_slope) or not change:
            return 0.0, False
        if self.dimension == "rate":
            return abs(change) * self.shape.peak_slope / abs(self.value), False
        return self.value, self.dimension == "distance"


def parse_dynamics(scope: Scope, element: Element, tag: str) -> Dynamics | None:
    """Parse the dynamics of an action; None, and a problem, if it is of no known shape."""
    found = element.find(tag)
    if found is None:
        scope.refuse(element, f"has no <{tag}>")
        return None
    shape, dimension = scope.get(found, "dynamicsShape"), scope.get(found, "dynamicsDimension")
    value = scope.get_number(found, "value")
    if shape not in SHAPES or dimension not in DIMENSIONS:
        scope.refuse(
            found,
            f"dynamics by '{shape[:20]}' and '{dimension[:20]}' are not read",
            f"shapes are {', '.join(SHAPES)}, dimensions {', '.join(DIMENSIONS)}",
        )
        return None
    if dimension == "rate" and shape != "step" and value == 0:
        scope.refuse(found, "a rate of 0 never ends")
        return None
    return Dynamics(SHAPES[shape], dimension, value)


class Transition:
    """A value on its way from one to another."""

    def __init__(self, dynamics: Dynamics, begin: float, end: float) -> None:
        self._shape, self.begin, self.end = dynamics.shape, begin, end
        self.length, self.is_by_distance = dynamics.measure(end - begin)
        self._covered = 0.0

    def advance(self, step_s: float, step_m: float) -> None:
        """Cover a step of time and distance."""
        self._covered += step_m if self.is_by_distance else step_s

    @property
    def is_done(self) -> bool:
        """Whether the end is reached."""
        return self._covered >= self.length - 1e-9

    @property
    def value(self) -> float:
        """The value by now."""
        if self.is_done:
            return self.end
        return self.begin + (self.end - self.begin) * self._shape.blend(self._covered / self.length)

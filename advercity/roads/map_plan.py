"""Maps as netconvert takes them: in metres, with traffic on the right."""

from dataclasses import dataclass
from typing import Literal
from xml.etree.ElementTree import Element

Side = Literal["left", "right"]


@dataclass(frozen=True, eq=False)
class MapPlan:
    """A map in the plan frame: east and north, or east and south if traffic is on the left.

    Attributes:
        root: The document.
        driving_side: Side on which traffic drives in the world.
        crossings: Places of the pedestrian crossings that the document does not tell netconvert of.
    """

    root: Element
    driving_side: Side = "right"
    crossings: tuple[tuple[float, float], ...] = ()

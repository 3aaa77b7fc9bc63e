"""Permitted users of a map's lanes, and the lanes' types in SUMO's network."""

from dataclasses import dataclass

DEFAULT_SPEED_M_S = 50 / 3.6
WALKING_SPEED_M_S = 2.78
CYCLING_SPEED_M_S = 5.56


@dataclass(frozen=True)
class LaneUse:
    """Permitted users of a lane, its speed if the map has no limit, and its type for SUMO.

    Attributes:
        permission: SUMO's attribute and vehicle classes.
        speed_m_s: Limit if the map has none.
        paving: Type of the lane in the network, which decides its material.
    """

    permission: tuple[str, str]
    speed_m_s: float
    paving: str = ""

    @property
    def is_walked(self) -> bool:
        """Whether it is for pedestrians alone."""
        return self.permission == ("allow", "pedestrian")

    @property
    def is_closed(self) -> bool:
        """Whether it is closed to all."""
        return self.permission == ("disallow", "all")


ROADWAY = LaneUse(("disallow", "pedestrian"), DEFAULT_SPEED_M_S, "driving")
WALK = LaneUse(("allow", "pedestrian"), WALKING_SPEED_M_S, "sidewalk")
SHOULDER = LaneUse(("disallow", "all"), DEFAULT_SPEED_M_S, "shoulder")


def reserve(classes: str, speed_m_s: float = DEFAULT_SPEED_M_S) -> LaneUse:
    """Make the use of a lane for some of SUMO's vehicle classes alone."""
    return LaneUse(("allow", classes), speed_m_s, "shoulder")

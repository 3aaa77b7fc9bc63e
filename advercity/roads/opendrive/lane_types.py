"""Lane types of OpenDRIVE 1.8, and what each becomes."""

from dataclasses import dataclass

DEFAULT_SPEED_M_S, RAMP_SPEED_M_S = 50 / 3.6, 80 / 3.6
WALKING_SPEED_M_S = 2.78
CYCLING_SPEED_M_S = 5.56


@dataclass(frozen=True)
class LaneUse:
    """Who may use a lane, how fast where the map has no limit, and the type that SUMO keeps.

    Attributes:
        permission: SUMO's attribute and vehicle classes.
        speed_m_s: Limit where the map has none.
        paving: Type of the lane in the network, which decides what it is made of.
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
        """Whether nobody may use it."""
        return self.permission == ("disallow", "all")


ROADWAY = LaneUse(("disallow", "pedestrian"), DEFAULT_SPEED_M_S, "driving")
RAMP = LaneUse(("disallow", "pedestrian"), RAMP_SPEED_M_S, "driving")
WALK = LaneUse(("allow", "pedestrian"), WALKING_SPEED_M_S, "sidewalk")
SHOULDER = LaneUse(("disallow", "all"), DEFAULT_SPEED_M_S, "shoulder")


def _reserved(classes: str, speed_m_s: float = DEFAULT_SPEED_M_S) -> LaneUse:
    return LaneUse(("allow", classes), speed_m_s, "shoulder")


LANE_USES: dict[str, LaneUse | None] = {
    "driving": ROADWAY,
    "bidirectional": ROADWAY,
    "slipLane": ROADWAY,
    "connectingRamp": RAMP,
    "entry": RAMP,
    "exit": RAMP,
    "onRamp": RAMP,
    "offRamp": RAMP,
    "mwyEntry": RAMP,
    "mwyExit": RAMP,
    "bus": _reserved("bus"),
    "taxi": _reserved("taxi"),
    "HOV": _reserved("hov"),
    "tram": _reserved("tram"),
    "biking": _reserved("bicycle", CYCLING_SPEED_M_S),
    "sidewalk": WALK,
    "walking": WALK,
    "shared": WALK,
    "curb": LaneUse(("disallow", "all"), WALKING_SPEED_M_S, "curb"),
    "parking": LaneUse(("disallow", "all"), DEFAULT_SPEED_M_S, "parking"),
    "border": SHOULDER,
    "shoulder": SHOULDER,
    "stop": SHOULDER,
    "restricted": SHOULDER,
    "roadWorks": SHOULDER,
    "special1": SHOULDER,
    "special2": SHOULDER,
    "special3": SHOULDER,
    "median": None,
    "rail": None,
    "none": None,
}
"""Use by type; None leaves the ground as it is."""

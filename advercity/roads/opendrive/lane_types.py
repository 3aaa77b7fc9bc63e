"""Lane types of OpenDRIVE 1.8, and their uses."""

from advercity.roads.lane_uses import (
    CYCLING_SPEED_M_S,
    DEFAULT_SPEED_M_S,
    ROADWAY,
    SHOULDER,
    WALK,
    WALKING_SPEED_M_S,
    LaneUse,
    reserve,
)

RAMP = LaneUse(("disallow", "pedestrian"), 80 / 3.6, "driving")
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
    "bus": reserve("bus"),
    "taxi": reserve("taxi"),
    "HOV": reserve("hov"),
    "tram": reserve("tram"),
    "biking": reserve("bicycle", CYCLING_SPEED_M_S),
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

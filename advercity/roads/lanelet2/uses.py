"""Subtypes, participants and speed limits of lanelets, by Lanelet2's tagging documents.

Missing speed limits are Germany's, the only country known to Lanelet2.
"""

import re
from collections.abc import Mapping

from advercity.roads.lane_uses import (
    CYCLING_SPEED_M_S,
    ROADWAY,
    SHOULDER,
    WALK,
    LaneUse,
    reserve,
)
from advercity.roads.osm_map import Tags

BUS, TAXI, BICYCLE = reserve("bus"), reserve("taxi"), reserve("bicycle", CYCLING_SPEED_M_S)
USES: Mapping[str, LaneUse] = {
    "road": ROADWAY,
    "highway": ROADWAY,
    "play_street": ROADWAY,
    "exit": ROADWAY,
    "emergency_lane": SHOULDER,
    "bus_lane": BUS,
    "bicycle_lane": BICYCLE,
    "walkway": WALK,
    "shared_walkway": WALK,
}
"""Uses by subtype; others are no lanes."""
PARTICIPANTS: Mapping[str, LaneUse] = {
    "vehicle": ROADWAY,
    "vehicle:car": ROADWAY,
    "vehicle:car:electric": ROADWAY,
    "vehicle:car:combustion": ROADWAY,
    "vehicle:truck": ROADWAY,
    "vehicle:motorcycle": ROADWAY,
    "vehicle:bus": BUS,
    "vehicle:taxi": TAXI,
    "vehicle:emergency": SHOULDER,
    "bicycle": BICYCLE,
    "pedestrian": WALK,
}
"""Uses by participant; the first allowed one decides, pedestrians before bicycles."""
LIMITS_KM_H: Mapping[tuple[str, str], float] = {
    ("road", "nonurban"): 100,
    ("bus_lane", "nonurban"): 100,
    ("highway", "urban"): 130,
    ("highway", "nonurban"): 130,
    ("play_street", "urban"): 7,
    ("play_street", "nonurban"): 7,
}
"""Limits by subtype and location; elsewhere the usual speed of the lane's use."""
SPEED = re.compile(r"(\d{1,3}(?:\.\d+)?)\s*(km/?h|kph|mph|mps|m/s)?", re.IGNORECASE)
UNITS_M_S = {"mph": 0.44704, "mps": 1.0, "m/s": 1.0}
"""Units other than km/h."""
GERMAN_SIGN = re.compile(r"de274(?:(?P<zone>[._]1)|[-.](?P<limit>\d{2,3}))(?:[-.]\d+)?")
"""Signs 274 (limit) and 274.1 (zone of 30 km/h)."""


def find_use(tags: Tags) -> LaneUse | None:
    """Find the use of a lanelet by its participants, else by its subtype; None if it is no lane."""
    prefix = "participant:"
    overrides = {
        key.removeprefix(prefix): value for key, value in tags.items() if key.startswith(prefix)
    }
    if not overrides or tags.get("subtype") == "crosswalk":
        return USES.get(tags.get("subtype", "road"))
    allowed = [use for key, use in PARTICIPANTS.items() if overrides.get(key) == "yes"]
    # Ways shared by cyclists and pedestrians are walked.
    return WALK if allowed[:1] == [BICYCLE] and WALK in allowed else next(iter(allowed), None)


def find_usual_limit_m_s(tags: Tags, use: LaneUse) -> float:
    """Find the limit of a lanelet for which the map gives none."""
    key = tags.get("subtype", "road"), tags.get("location", "urban")
    return LIMITS_KM_H.get(key, use.speed_m_s * 3.6) / 3.6


def parse_limit_m_s(text: str) -> float | None:
    """Parse a speed, km/h without a unit, or the number of a German sign; None if it is neither."""
    sign = GERMAN_SIGN.fullmatch(text.strip())
    if sign is not None:
        return (30.0 if sign["zone"] else float(sign["limit"])) / 3.6 or None
    found = SPEED.fullmatch(text.strip())
    if found is None:
        return None
    unit = (found[2] or "").lower()
    return float(found[1]) * UNITS_M_S.get(unit, 1 / 3.6) or None

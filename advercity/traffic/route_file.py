"""Write the demand as a SUMO route file.

Every actor has its own vehicle type, as SUMO keeps sizes and driving in types.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from math import inf
from pathlib import Path
from xml.etree.ElementTree import Element, ElementTree, SubElement, indent

from advercity_dsl import ActorClass, DriverResponse

from advercity.conflicts.ego_motion import CONNECTED_ACCELERATION_M_S2
from advercity.traffic.demand import TrafficDemand, VehicleTrip
from advercity.traffic.driving_styles import MEDIAN_STYLE, DrivingStyle
from advercity.traffic.pedestrians import PedestrianTrip


@dataclass(frozen=True)
class CarFollowing:
    """Driving of a class of vehicles: Krauss' car-following model.

    Each driver has its own ratios to these values. SUMO's own dawdling depends on all others in a
    lane, so changes of speed are commanded instead (`DrivingStyle.sway_at`).

    Attributes:
        sumo_class: SUMO's vehicle class.
        acceleration_m_s2: Maximum acceleration.
        deceleration_m_s2: Maximum braking in everyday traffic.
        max_emergency_braking_m_s2: Maximum braking on the road in an emergency.
        headway_s: Time gap to the vehicle ahead; also the driver's reaction time.
        standing_gap_m: Gap to the vehicle ahead at standstill.
        alignment: Lateral position in the lane, in SUMO's words.
    """

    sumo_class: str
    acceleration_m_s2: float
    deceleration_m_s2: float
    max_emergency_braking_m_s2: float = inf
    headway_s: float = 1.0
    standing_gap_m: float = 2.5
    alignment: str = "center"


CAR_FOLLOWING: Mapping[ActorClass, CarFollowing] = {
    "car": CarFollowing("passenger", 2.2, 3.0),
    "van": CarFollowing("delivery", CONNECTED_ACCELERATION_M_S2["van"], 3.0),
    "truck": CarFollowing("truck", CONNECTED_ACCELERATION_M_S2["truck"], 2.5, headway_s=1.3),
    "bicycle": CarFollowing("bicycle", 1.0, 2.0, standing_gap_m=1.0, alignment="right"),
    "motorcycle": CarFollowing("motorcycle", 2.8, 3.0, standing_gap_m=1.5),
}
"""Driving by class; the gaps apply at a red light, the original's 5 m at the start."""
CONNECTED_CAR_FOLLOWING = CarFollowing(
    "passenger", CONNECTED_ACCELERATION_M_S2["car"], 3.0, standing_gap_m=3.0
)
EMERGENCY_EXTRA_M_S2 = 4.0
"""Emergency braking less everyday braking."""
LATERAL_SPEED_FRACTION = 0.2
"""Maximum lateral speed of a vehicle as a fraction of its speed."""
UNLIMITED_SPEED_FACTOR = 10.0
"""Speed factor of a vehicle limited only by its own top speed."""
WALKING_GAP_M = 0.8
"""Gap to the person ahead, large enough for bodies to step aside without contact."""
STOP_LENGTH_M = 1.0
"""Length of the part of a lane for a vehicle waiting at its start."""


def write_route_file(
    demand: TrafficDemand, path: Path, caution: DriverResponse | None = None
) -> None:
    """Write vehicles and people, each with a type of its own, in order of departure.

    Args:
        demand: The vehicles and people.
        path: File to write.
        caution: Drivers' response to the weather; staged vehicles do not respond.
    """
    root = Element("routes")
    for trip in demand.connected:
        driving = find_driving(trip, is_connected=True)
        _add_vehicle_type(root, trip, apply_driver_response(driving, caution))
    for trip in demand.staged:
        _add_vehicle_type(root, trip, find_driving(trip))
    for trip in demand.vehicles:
        driving = apply_driver_response(find_driving(trip), caution)
        _add_vehicle_type(root, trip, apply_style(driving, trip.style))
    for trip in demand.walkers:
        _add_pedestrian_type(root, trip)
    # SUMO skips actors with an earlier departure than the one above them in the file.
    for trip in sorted((*demand.trips, *demand.walkers), key=lambda trip: trip.depart_s):
        _add_vehicle(root, trip) if isinstance(trip, VehicleTrip) else _add_person(root, trip)
    indent(root)
    ElementTree(root).write(path, encoding="utf-8")


def find_driving(trip: VehicleTrip, *, is_connected: bool = False) -> CarFollowing:
    """Find the driving of a trip's class in clear weather."""
    usual = CAR_FOLLOWING[trip.actor.actor_class]
    if not is_connected:
        return usual
    # A connected vehicle keeps to the middle of its lane, as its conflicts are solved there.
    return replace(
        CONNECTED_CAR_FOLLOWING,
        acceleration_m_s2=CONNECTED_ACCELERATION_M_S2[trip.actor.actor_class],
        deceleration_m_s2=min(usual.deceleration_m_s2, CONNECTED_CAR_FOLLOWING.deceleration_m_s2),
    )


def apply_driver_response(driving: CarFollowing, caution: DriverResponse | None) -> CarFollowing:
    """Change driving for weather: longer headways, and accelerations within the road's grip."""
    if caution is None:
        return driving
    return replace(
        driving,
        acceleration_m_s2=min(driving.acceleration_m_s2, caution.usual_m_s2),
        deceleration_m_s2=min(driving.deceleration_m_s2, caution.usual_m_s2),
        max_emergency_braking_m_s2=min(driving.max_emergency_braking_m_s2, caution.hardest_m_s2),
        headway_s=driving.headway_s + caution.headway_s,
    )


def apply_style(driving: CarFollowing, style: DrivingStyle) -> CarFollowing:
    """Change driving by a driver's own ratios; in an emergency all brake alike."""
    if style is MEDIAN_STYLE:
        return driving
    hardest = min(
        driving.deceleration_m_s2 + EMERGENCY_EXTRA_M_S2, driving.max_emergency_braking_m_s2
    )
    return replace(
        driving,
        acceleration_m_s2=style.acceleration_ratio * driving.acceleration_m_s2,
        deceleration_m_s2=min(style.braking_ratio * driving.deceleration_m_s2, hardest),
        max_emergency_braking_m_s2=hardest,
        headway_s=style.headway_ratio * driving.headway_s,
        standing_gap_m=style.gap_ratio * driving.standing_gap_m,
    )


def compute_limits(trip: VehicleTrip, driving: CarFollowing) -> CarFollowing:
    """Compute a vehicle's driving with its own limits, if it has them; all are finite."""
    usual = driving.acceleration_m_s2, driving.deceleration_m_s2
    acceleration, braking = trip.acceleration_limits_m_s2 or usual
    hardest = min(braking + EMERGENCY_EXTRA_M_S2, driving.max_emergency_braking_m_s2)
    return replace(
        driving,
        acceleration_m_s2=acceleration,
        deceleration_m_s2=braking,
        max_emergency_braking_m_s2=hardest,
    )


def _add_vehicle_type(root: Element, trip: VehicleTrip, driving: CarFollowing) -> None:
    _, width, height = trip.actor.size
    limits = compute_limits(trip, driving)
    factor = UNLIMITED_SPEED_FACTOR if trip.speed_factor is None else trip.speed_factor
    _add_element(
        root,
        "vType",
        id=trip.actor.id,
        vClass=driving.sumo_class,
        length=trip.length_m,
        width=width,
        height=height,
        accel=limits.acceleration_m_s2,
        decel=limits.deceleration_m_s2,
        emergencyDecel=limits.max_emergency_braking_m_s2,
        tau=driving.headway_s,
        minGap=driving.standing_gap_m,
        maxSpeed=trip.top_speed_m_s,
        speedFactor=factor,
        # No chance: dry runs need the same behaviour in a second run, independent of others.
        speedDev=0,
        sigma=0,
        latAlignment=driving.alignment,
        lcMaxSpeedLatStanding=0,
        lcMaxSpeedLatFactor=LATERAL_SPEED_FRACTION,
        # Only the lane changes of the route, and those early.
        lcStrategic=10,
        lcSpeedGain=0,
        lcKeepRight=0,
        lcCooperative=0,
    )


def _add_vehicle(root: Element, trip: VehicleTrip) -> None:
    vehicle = _add_element(
        root,
        "vehicle",
        id=trip.actor.id,
        type=trip.actor.id,
        depart=trip.depart_s,
        departLane=trip.lane,
        departPos="base" if trip.front_position_m is None else trip.front_position_m,
        departPosLat=find_driving(trip).alignment,
        departSpeed=trip.start_speed_m_s,
    )
    _add_element(vehicle, "route", edges=" ".join(trip.edges))
    if trip.waits_s > 0 and trip.front_position_m is not None:
        _add_element(
            vehicle,
            "stop",
            lane=f"{trip.edges[0]}_{trip.lane}",
            startPos=max(trip.front_position_m - STOP_LENGTH_M, 0.0),
            endPos=trip.front_position_m,
            until=trip.waits_s,
        )


def _add_pedestrian_type(root: Element, trip: PedestrianTrip) -> None:
    length, width, height = trip.actor.size
    _add_element(
        root,
        "vType",
        id=trip.actor.id,
        vClass="pedestrian",
        length=length,
        width=width,
        height=height,
        minGap=WALKING_GAP_M,
        maxSpeed=trip.speed_m_s,
        speedFactor=1,
        speedDev=0,
    )


def _add_person(root: Element, trip: PedestrianTrip) -> None:
    person = _add_element(
        root,
        "person",
        id=trip.actor.id,
        type=trip.actor.id,
        depart=trip.depart_s,
        departPos=trip.start_m,
    )
    for leg in trip.legs:
        _add_element(person, "walk", edges=" ".join(leg.edges), arrivalPos=leg.end_position_m)


def _add_element(parent: Element, tag: str, **attributes: float | str) -> Element:
    texts = {
        name: f"{value:.3f}" if isinstance(value, float) else str(value)
        for name, value in attributes.items()
    }
    return SubElement(parent, tag, texts)

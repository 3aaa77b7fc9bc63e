"""The demand as a SUMO route file."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from math import inf
from pathlib import Path
from xml.etree.ElementTree import Element, ElementTree, SubElement, indent

from advercity_dsl import ActorClass, DriverResponse

from advercity.traffic.demand import TrafficDemand, VehicleTrip
from advercity.traffic.pedestrians import PedestrianTrip


@dataclass(frozen=True)
class CarFollowing:
    """How a class of vehicle drives: Krauss' car-following model without dawdling.

    Attributes:
        sumo_class: SUMO's vehicle class.
        acceleration_m_s2: Most it accelerates.
        deceleration_m_s2: Most it brakes in everyday traffic.
        max_emergency_braking_m_s2: Most that the road lets it brake in an emergency.
        headway_s: Time gap it keeps; also the driver's reaction time.
        standing_gap_m: Standing gap to the vehicle ahead.
        alignment: Where it drives in its lane.
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
    "van": CarFollowing("delivery", 2.0, 3.0),
    "truck": CarFollowing("truck", 1.2, 2.5, headway_s=1.3),
    "bicycle": CarFollowing("bicycle", 1.0, 2.0, standing_gap_m=1.0, alignment="right"),
    "motorcycle": CarFollowing("motorcycle", 2.8, 3.0, standing_gap_m=1.5),
}
"""The standing gap is what drivers keep at a red light; the original's 5 m apply at the start."""
CONNECTED_CAR_FOLLOWING = CarFollowing("passenger", 2.5, 3.0, standing_gap_m=3.0)
EMERGENCY_EXTRA_M_S2 = 4.0
"""How much harder one brakes in an emergency."""
LATERAL_SPEED_FRACTION = 0.2
"""Most of its speed that a vehicle moves sideways."""
UNLIMITED_SPEED_FACTOR = 10.0
"""Speed factor of a vehicle whose own top speed rules."""


def write_route_file(
    demand: TrafficDemand, path: Path, caution: DriverResponse | None = None
) -> None:
    """Write vehicles and people, each with a type of its own, in order of departure.

    Args:
        demand: Who takes part.
        path: File to write.
        caution: What drivers do about the weather; those in staged conflicts do as these say.
    """
    root = Element("routes")
    for ride in demand.connected:
        _add_vehicle_type(root, ride, _apply_driver_response(CONNECTED_CAR_FOLLOWING, caution))
    for ride in demand.staged:
        _add_vehicle_type(root, ride, CAR_FOLLOWING[ride.actor.actor_class])
    for ride in demand.vehicles:
        _add_vehicle_type(
            root, ride, _apply_driver_response(CAR_FOLLOWING[ride.actor.actor_class], caution)
        )
    for walk in demand.walkers:
        _add_pedestrian_type(root, walk)
    everyone = sorted((*demand.trips, *demand.walkers), key=lambda one: one.depart_s)
    for one in everyone:
        _add_vehicle(root, one) if isinstance(one, VehicleTrip) else _add_person(root, one)
    indent(root)
    ElementTree(root).write(path, encoding="utf-8")


def _apply_driver_response(driving: CarFollowing, caution: DriverResponse | None) -> CarFollowing:
    """The same as drivers do it who leave more time and brake no harder than the road lets them."""
    if caution is None:
        return driving
    return replace(
        driving,
        acceleration_m_s2=min(driving.acceleration_m_s2, caution.usual_m_s2),
        deceleration_m_s2=min(driving.deceleration_m_s2, caution.usual_m_s2),
        max_emergency_braking_m_s2=min(driving.max_emergency_braking_m_s2, caution.hardest_m_s2),
        headway_s=driving.headway_s + caution.headway_s,
    )


def _add_vehicle_type(root: Element, ride: VehicleTrip, driving: CarFollowing) -> None:
    length, width, height = ride.actor.size
    usual = driving.acceleration_m_s2, driving.deceleration_m_s2
    accelerates, brakes = ride.acceleration_limits_m_s2 or usual
    factor = UNLIMITED_SPEED_FACTOR if ride.speed_factor is None else ride.speed_factor
    _add_element(
        root,
        "vType",
        id=ride.actor.id,
        vClass=driving.sumo_class,
        length=length,
        width=width,
        height=height,
        accel=accelerates,
        decel=brakes,
        emergencyDecel=min(brakes + EMERGENCY_EXTRA_M_S2, driving.max_emergency_braking_m_s2),
        tau=driving.headway_s,
        minGap=driving.standing_gap_m,
        maxSpeed=ride.top_speed_m_s,
        speedFactor=factor,
        speedDev=0,
        sigma=0,
        latAlignment=driving.alignment,
        lcMaxSpeedLatStanding=0,
        lcMaxSpeedLatFactor=LATERAL_SPEED_FRACTION,
        lcStrategic=10,
        lcSpeedGain=0,
        lcKeepRight=0,
        lcCooperative=0,
    )


def _add_vehicle(root: Element, ride: VehicleTrip) -> None:
    vehicle = _add_element(
        root,
        "vehicle",
        id=ride.actor.id,
        type=ride.actor.id,
        depart=ride.depart_s,
        departLane=ride.lane,
        departPos="base" if ride.front_position_m is None else ride.front_position_m,
        departSpeed=ride.start_speed_m_s,
    )
    _add_element(vehicle, "route", edges=" ".join(ride.edges))


def _add_pedestrian_type(root: Element, walk: PedestrianTrip) -> None:
    length, width, height = walk.actor.size
    _add_element(
        root,
        "vType",
        id=walk.actor.id,
        vClass="pedestrian",
        length=length,
        width=width,
        height=height,
        minGap=0.25,
        maxSpeed=walk.speed_m_s,
        speedFactor=1,
        speedDev=0,
    )


def _add_person(root: Element, walk: PedestrianTrip) -> None:
    person = _add_element(
        root,
        "person",
        id=walk.actor.id,
        type=walk.actor.id,
        depart=walk.depart_s,
        departPos=walk.start_m,
    )
    for leg in walk.legs:
        _add_element(person, "walk", edges=" ".join(leg.edges), arrivalPos=leg.end_position_m)


def _add_element(parent: Element, tag: str, **attributes: float | str) -> Element:
    texts = {
        name: f"{value:.3f}" if isinstance(value, float) else str(value)
        for name, value in attributes.items()
    }
    return SubElement(parent, tag, texts)

"""SUMO's answers without the Python around them, which takes as long again as a short answer.

libsumo's public functions do nothing but call these, which its build makes of them by name.
"""

from collections.abc import Callable

from libsumo import _libsumo  # pyright: ignore[reportPrivateUsage]

Position = tuple[float, float, float]
IdQuery = Callable[[], tuple[str, ...]]

departed_vehicle_ids: IdQuery = _libsumo.simulation_getDepartedIDList
arrived_vehicle_ids: IdQuery = _libsumo.simulation_getArrivedIDList
vehicle_position: Callable[[str], Position] = _libsumo.vehicle_getPosition3D
vehicle_angle: Callable[[str], float] = _libsumo.vehicle_getAngle
vehicle_slope: Callable[[str], float] = _libsumo.vehicle_getSlope
vehicle_speed: Callable[[str], float] = _libsumo.vehicle_getSpeed
vehicle_signals: Callable[[str], int] = _libsumo.vehicle_getSignals
vehicle_edge: Callable[[str], str] = _libsumo.vehicle_getRoadID
vehicle_lane_position: Callable[[str], float] = _libsumo.vehicle_getLanePosition
set_vehicle_max_speed: Callable[[str, float], None] = _libsumo.vehicle_setMaxSpeed
departed_person_ids: IdQuery = _libsumo.simulation_getDepartedPersonIDList
arrived_person_ids: IdQuery = _libsumo.simulation_getArrivedPersonIDList
person_position: Callable[[str], Position] = _libsumo.person_getPosition3D
person_angle: Callable[[str], float] = _libsumo.person_getAngle
person_speed: Callable[[str], float] = _libsumo.person_getSpeed
traffic_light_state: Callable[[str], str] = _libsumo.trafficlight_getRedYellowGreenState

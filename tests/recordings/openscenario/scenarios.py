"""Scenarios that tests write: what entities do, on a map of one or several streets.

Entities are `Ego` and `Other`, cars whose boxes have their centre `REAR_AXLE_M` ahead of the rear
axle, to which all places refer, `Truck` and `Walker`.
"""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from advercity.recordings.openscenario.scenario import read_scenario
from advercity.recordings.tracks import Track
from tests.recordings.recorded_files import REAR_AXLE_M, write_openscenario, write_street
from tests.roads.opendrive_maps import lane, road, section

EGO_AT_20 = '<LanePosition roadId="1" laneId="-1" s="20"/>'


def play(
    folder: Path, *groups: str, init: str = "", end_s: float = 10.0, streets: str = ""
) -> dict[str, Track]:
    """Play a scenario that ends at a time; return the tracks by entity."""
    map_file = write_street(folder)
    if streets:
        map_file.write_text(f"<OpenDRIVE><header/>{streets}</OpenDRIVE>")
    act = f'<Story name="s"><Act name="a">{"".join(groups)}</Act></Story>'
    stop = f"<StopTrigger><ConditionGroup>{at(end_s)}</ConditionGroup></StopTrigger>"
    body = f"<Init><Actions>{init}</Actions></Init>{act}{stop}"
    path = write_openscenario(folder, body=body)
    return {track.id: track for track in read_scenario(path).tracks}


def find_rear_axle(track: Track, *times_s: float) -> NDArray[np.float64]:
    """Return where the rear axle of a car is at times, (n, 2) in m."""
    heading = track.headings_rad
    ahead = REAR_AXLE_M * np.column_stack([np.cos(heading), np.sin(heading)])
    places = track.places - ahead
    return np.column_stack([np.interp(times_s, track.times_s, item) for item in places.T])


def find_heading(track: Track, time_s: float) -> float:
    """Return the heading at a time, in rad."""
    return float(np.interp(time_s, track.times_s, track.headings_rad))


def begin(name: str, place: str, speed_m_s: float | None = None, *actions: str) -> str:
    """Write where an entity begins, how fast, and what it does from there."""
    moves = [f"<TeleportAction><Position>{place}</Position></TeleportAction>"]
    if speed_m_s is not None:
        moves.append(change_speed(speed_m_s))
    wrapped = "".join(f"<PrivateAction>{item}</PrivateAction>" for item in (*moves, *actions))
    return f'<Private entityRef="{name}">{wrapped}</Private>'


def maneuver(name: str, *events: str) -> str:
    """Write the events of an entity."""
    return f"""<ManeuverGroup name="{name}"><Actors><EntityRef entityRef="{name}"/></Actors>
      <Maneuver name="{name}">{"".join(events)}</Maneuver></ManeuverGroup>"""


def event(action: str, trigger: str, **attributes: str) -> str:
    """Write an event of one action."""
    attributes = {"name": "e", "priority": "parallel", **attributes}
    return f"""<Event{_format(attributes)}><Action name="x"><PrivateAction>{action}
      </PrivateAction></Action><StartTrigger><ConditionGroup>{trigger}</ConditionGroup>
      </StartTrigger></Event>"""


def at(time_s: float) -> str:
    """Write the condition that a time is reached."""
    return value(f'<SimulationTimeCondition value="{time_s}" rule="greaterOrEqual"/>')


def value(condition: str, **attributes: str) -> str:
    """Write a condition on values."""
    return _condition(f"<ByValueCondition>{condition}</ByValueCondition>", attributes)


def of_entity(condition: str, *names: str, rule: str = "any", **attributes: str) -> str:
    """Write a condition on entities."""
    entities = "".join(f'<EntityRef entityRef="{name}"/>' for name in names or ("Ego",))
    return _condition(
        f"""<ByEntityCondition><TriggeringEntities triggeringEntitiesRule="{rule}">{entities}
        </TriggeringEntities><EntityCondition>{condition}</EntityCondition></ByEntityCondition>""",
        attributes,
    )


def change_speed(
    speed_m_s: float, shape: str = "step", dimension: str = "time", amount: float = 0.0
) -> str:
    """Write a change of speed."""
    return f"""<LongitudinalAction><SpeedAction>
      {_write_dynamics("SpeedActionDynamics", shape, dimension, amount)}
      <SpeedActionTarget><AbsoluteTargetSpeed value="{speed_m_s}"/></SpeedActionTarget>
      </SpeedAction></LongitudinalAction>"""


def change_lane(
    lane_id: int, shape: str = "sinusoidal", dimension: str = "time", amount: float = 4.0
) -> str:
    """Write a change of lane."""
    return f"""<LateralAction><LaneChangeAction>
      {_write_dynamics("LaneChangeActionDynamics", shape, dimension, amount)}
      <LaneChangeTarget><AbsoluteTargetLane value="{lane_id}"/></LaneChangeTarget>
      </LaneChangeAction></LateralAction>"""


def follow(*places: str, timing: str = "<None/>") -> str:
    """Write a trajectory; places are positions, with the time where it counts."""
    parts = [place.partition("<") for place in places]
    vertices = "".join(
        f"<Vertex {time}><Position><{place}</Position></Vertex>" for time, _, place in parts
    )
    return f"""<RoutingAction><FollowTrajectoryAction><TrajectoryRef>
      <Trajectory name="t" closed="false"><Shape><Polyline>{vertices}</Polyline></Shape>
      </Trajectory></TrajectoryRef><TimeReference>{timing}</TimeReference>
      <TrajectoryFollowingMode followingMode="position"/>
      </FollowTrajectoryAction></RoutingAction>"""


def world(x: float, y: float, h: float | None = None) -> str:
    """Write a place in the world."""
    heading = "" if h is None else f' h="{h}"'
    return f'<WorldPosition x="{x}" y="{y}"{heading}/>'


def write_opposite_roads() -> str:
    """Write two roads from west to east, of 200 m each; the second one is drawn from its end."""
    lanes = section(0.0, *(lane(number, "driving", 3.5) for number in (1, -1)))
    ahead = '<successor elementType="road" elementId="2" contactPoint="end"/>'
    back = '<successor elementType="road" elementId="1" contactPoint="end"/>'
    return road("1", 200.0, lanes, link=ahead) + road(
        "2", 200.0, lanes, start=(400.0, 0.0, np.pi), link=back
    )


def _write_dynamics(tag: str, shape: str, dimension: str, amount: float) -> str:
    return f'<{tag} dynamicsShape="{shape}" dynamicsDimension="{dimension}" value="{amount}"/>'


def _condition(inner: str, attributes: Mapping[str, str]) -> str:
    attributes = {"name": "c", "delay": "0", "conditionEdge": "none", **attributes}
    return f"<Condition{_format(attributes)}>{inner}</Condition>"


def _format(attributes: Mapping[str, str]) -> str:
    return "".join(f' {key}="{item}"' for key, item in attributes.items())

"""Scenarios whose actors follow trajectories by time are read; what else moves them is refused."""

import math
from pathlib import Path

import numpy as np
import pytest

from advercity.diagnostics import DiagnosticsError
from advercity.errors import InputError
from advercity.recordings.openscenario.scenario import read_scenario
from tests.recordings.recorded_files import (
    REAR_AXLE_M,
    format_start,
    format_teleport,
    format_trajectory,
    format_vertex,
    write_openscenario,
    write_street,
)

TWO = format_vertex(0, 0, 0, 0) + format_vertex(1, 5, 0, 0)


def test_places_are_centres_of_boxes_not_of_rear_axles(tmp_path: Path) -> None:
    scenario = read_scenario(write_openscenario(tmp_path))
    tracks = {track.id: track for track in scenario.tracks}

    assert scenario.map_file == "hill.xodr"
    ego = tracks["Ego"]
    assert (ego.actor_class, ego.size) == ("car", (4.6, 1.8, 1.5))  # the length is a parameter
    # It waits where it was put until its trigger, and drives from then on.
    assert (ego.times_s[0], ego.times_s[-1]) == (0.0, 5.0)
    assert np.interp([0.0, 1.0, 3.0], ego.times_s, ego.places[:, 0]) == pytest.approx([50, 50, 72])
    # One that drives to the west has its rear axle in the east of its centre.
    other = tracks["Other"]
    assert other.places[[0, -1]] == pytest.approx(np.array([[160, 1.75], [120, 1.75]]))
    assert np.cos(other.headings_rad) == pytest.approx(-1.0)
    assert tracks["Truck"].actor_class == "truck"
    assert np.abs(tracks["Truck"].places - [120.0, -1.75]).max() == pytest.approx(0.0)
    walker = tracks["Walker"]
    assert walker.headings_rad == pytest.approx(math.pi / 2)
    # Of two vertices, what is between them is on the line between them.
    assert np.diff(walker.times_s).max() <= 0.5
    assert walker.places[:, 1] == pytest.approx(-8 + 1.25 * walker.times_s)


def test_times_are_scaled_and_moved_as_their_reference_says(tmp_path: Path) -> None:
    absolute = '<Timing domainAbsoluteRelative="absolute" scale="2" offset="0.5"/>'
    group = format_trajectory("Ego", TWO, start=format_start(0), timing=absolute)
    (ego,) = read_scenario(write_openscenario(tmp_path, body=_story(group))).tracks
    assert (ego.times_s[0], ego.times_s[-1]) == (0.5, 2.5)


def test_an_entity_is_there_from_being_added_to_being_deleted(tmp_path: Path) -> None:
    place = '<Position><WorldPosition x="0" y="0" h="0"/></Position>'
    added = f"<AddEntityAction>{place}</AddEntityAction>"
    vertices = "".join(format_vertex(t, 5 * t, 0, 0) for t in range(10))
    groups = (
        format_trajectory("Ego", vertices, start=format_start(2)),
        _change_entity("Ego", added, 2.0),
        _change_entity("Ego", "<DeleteEntityAction/>", 6.5),
    )
    (ego,) = read_scenario(write_openscenario(tmp_path, body=_story(*groups))).tracks
    assert (ego.times_s[0], ego.times_s[-1]) == (2.0, 6.5)


def test_all_motion_ends_where_the_storyboard_stops(tmp_path: Path) -> None:
    vertices = "".join(format_vertex(t, 5 * t, 0, 0) for t in range(10))
    body = _story(format_trajectory("Ego", vertices)).replace("<StopTrigger/>", STOP)
    (ego,) = read_scenario(write_openscenario(tmp_path, body=body)).tracks
    assert ego.times_s[-1] == pytest.approx(2.0, abs=0.5)


def _story(*groups: str, init: str = "") -> str:
    act = f'<Story name="s"><Act name="a">{"".join(groups)}</Act></Story>'
    return f"<Init><Actions>{init}</Actions></Init>{act}<StopTrigger/>"


def _change_entity(name: str, action: str, time_s: float) -> str:
    inner = f'<EntityAction entityRef="{name}">{action}</EntityAction>'
    trigger = f"<ConditionGroup>{format_start(time_s)}</ConditionGroup>"
    return f"""<ManeuverGroup name="e"><Actors selectTriggeringEntities="false"/>
      <Maneuver name="e"><Event name="e">
      <Action name="e"><GlobalAction>{inner}</GlobalAction></Action>
      <StartTrigger>{trigger}</StartTrigger></Event></Maneuver></ManeuverGroup>"""


KEEP_DISTANCE = """<ManeuverGroup name="g"><Actors><EntityRef entityRef="Ego"/></Actors>
  <Maneuver name="m"><Event name="e"><Action name="x"><PrivateAction><LongitudinalAction>
  <LongitudinalDistanceAction/></LongitudinalAction></PrivateAction></Action></Event></Maneuver>
  </ManeuverGroup>"""
NEAR = """<Condition name="c"><ByEntityCondition><EntityCondition>
  <RelativeClearanceCondition/></EntityCondition></ByEntityCondition></Condition>"""
NEAR_IN_ONE = "".join(NEAR.split("\n"))
LANE_PLACE = '<Position><GeoPosition latitudeDeg="50" longitudeDeg="6"/></Position>'
TIMING = '<Timing domainAbsoluteRelative="absolute" scale="{}" offset="0"/>'
LONG = format_vertex(0, 0, 0, 0) + format_vertex(100_000, 5, 0, 0)
NURBS = "<Nurbs order='4'/>"


STOP = f"<StopTrigger><ConditionGroup>{format_start(2)}</ConditionGroup></StopTrigger>"


def _start_at_speed(name: str, speed_m_s: float) -> str:
    target = f'<AbsoluteTargetSpeed value="{speed_m_s}"/>'
    dynamics = '<SpeedActionDynamics dynamicsShape="step" dynamicsDimension="time" value="0"/>'
    speed = f"<SpeedAction>{dynamics}<SpeedActionTarget>{target}</SpeedActionTarget></SpeedAction>"
    action = f"<PrivateAction><LongitudinalAction>{speed}</LongitudinalAction></PrivateAction>"
    return f'<Private entityRef="{name}">{action}</Private>'


@pytest.mark.parametrize(
    ("body", "expected"),
    {
        _story(KEEP_DISTANCE): (
            "<LongitudinalDistanceAction>: such an action is not read; record the motion as a"
        ),
        _story(format_trajectory("Ego", TWO, start=NEAR_IN_ONE)): (
            "<RelativeClearanceCondition>: such a condition is not read; write the time at which"
        ),
        _story(format_trajectory("Ego", f'<Vertex time="0">{LANE_PLACE}</Vertex>')): (
            "<GeoPosition>: such a position is not read; give it as a <WorldPosition>"
        ),
        _story(format_trajectory("Ego", TWO)).replace(f"<Polyline>{TWO}</Polyline>", NURBS): (
            "<Nurbs>: such a shape is not read; sample it as the vertices of a <Polyline>"
        ),
        _story(format_trajectory("Nobody", TWO)): "<EntityRef>: there is no entity 'Nobody'",
        _story(format_trajectory("Ego", TWO + TWO)): (
            "<Vertex>: is at 0 s, no later than the vertex before, 1 s; order vertices by time"
        ),
        _story(format_trajectory("Ego", format_vertex(1, 0, 0, 0) * 2)): (
            "<Vertex>: is at 1 s, no later than the vertex before, 1 s; order vertices by time"
        ),
        _story(format_trajectory("Ego", TWO.replace('"1"', '"1e12"'))): (
            "<Vertex>: is at 1e+12 s; a scenario takes at most 100,000 s; times are in s from its"
        ),
        _story(format_trajectory("Ego", TWO, timing=TIMING.format("1e9"))): (
            "<Vertex>: is at 1e+09 s; a scenario takes at most 100,000 s; times are in s from its"
        ),
        _story(format_trajectory("Ego", TWO, timing=TIMING.format("-1"))): (
            "<Vertex>: is at -1 s, no later than the vertex before, 0 s; order vertices by time"
        ),
        _story(format_trajectory("Ego", TWO.replace('x="5', 'x="fast'))): (
            '<WorldPosition>: x="fast.000000" is not a number'
        ),
        _story(format_trajectory("Ego", TWO.replace('"5.000000"', '"$speed"'))): (
            "<WorldPosition>: '$speed' has no value"
        ),
        _story(init=format_teleport("Ego", 0, 0, 0)): "no entity moves",
    }.items(),
)
def test_what_would_be_another_scenario_is_refused_by_name_and_line(
    body: str, expected: str, tmp_path: Path
) -> None:
    path = write_openscenario(tmp_path, body=body)
    with pytest.raises(DiagnosticsError) as caught:
        read_scenario(path)
    (diagnostic,) = caught.value.diagnostics
    assert expected in diagnostic.headline
    # The place is that of the element, in the file as it is.
    tag = diagnostic.value_path.strip("<>")
    line = path.read_text().splitlines()[diagnostic.line - 1]
    assert line[diagnostic.column - 1 :].startswith(f"<{tag}")


def test_many_long_trajectories_take_no_more_memory_than_a_machine_has(tmp_path: Path) -> None:
    path = write_openscenario(tmp_path, body=_story(format_trajectory("Ego", LONG)))
    text = path.read_text()
    before, _, rest = text.partition('<ScenarioObject name="Truck">')
    _, _, after = rest.partition("</ScenarioObject>")
    truck = '<ScenarioObject name="Truck">' + rest.partition("</ScenarioObject>")[0]
    names = [f"T{number}" for number in range(60)]
    trucks = "".join(truck.replace('"Truck"', f'"{n}"') + "</ScenarioObject>" for n in names)
    places = "".join(format_teleport(name, 0, 0, 0) for name in names)
    path.write_text((before + trucks + after).replace("<Actions>", f"<Actions>{places}"))
    with pytest.raises(InputError, match="have more than 2,000,000 places, with one every"):
        read_scenario(path)


def test_one_with_a_speed_and_no_trajectory_drives_on_along_its_lane(tmp_path: Path) -> None:
    write_street(tmp_path)
    vertices = "".join(format_vertex(t, 5 * t, -1.75, 0) for t in range(9))
    init = format_teleport("Other", 250, 1.75, math.pi) + _start_at_speed("Other", 7.5)
    path = write_openscenario(tmp_path, body=_story(format_trajectory("Ego", vertices), init=init))
    other = {track.id: track for track in read_scenario(path).tracks}["Other"]
    assert other.times_s[-1] == pytest.approx(8.0)
    assert other.places[-1] == pytest.approx([250 - REAR_AXLE_M - 7.5 * 8, 1.75])


def test_an_event_that_overwrites_ends_the_one_before(tmp_path: Path) -> None:
    first = format_trajectory("Ego", TWO.replace('"1"', '"10"').replace("5.0", "100.0"))
    second = format_trajectory(
        "Ego",
        format_vertex(0, 40, 0, 0) + format_vertex(5.3, 52, 0, 0),
        start=format_start(4),
    )
    event = second[second.index("<Event") : second.index("</Maneuver>")]
    group = first.replace("</Maneuver>", event.replace('"parallel"', '"overwrite"') + "</Maneuver>")
    (ego,) = read_scenario(write_openscenario(tmp_path, body=_story(group))).tracks
    assert np.interp(3.9, ego.times_s, ego.places[:, 0]) == pytest.approx(39 + REAR_AXLE_M)
    assert ego.times_s[-1] == pytest.approx(9.3)
    assert ego.places[-1, 0] == pytest.approx(52 + REAR_AXLE_M)
    parallel = read_scenario(
        write_openscenario(tmp_path, body=_story(group.replace("overwrite", "skip")))
    )
    # An event that is skipped leaves the first one as it was.
    assert parallel.tracks[0].places[-1, 0] == pytest.approx(100 + REAR_AXLE_M)


def test_an_actor_changes_lane_and_speed_as_written(tmp_path: Path) -> None:
    write_street(tmp_path)
    lane = '<LanePosition roadId="1" laneId="-1" s="${20 + $length - 4.6}"/>'
    change = """<LateralAction><LaneChangeAction>
      <LaneChangeActionDynamics dynamicsShape="sinusoidal" dynamicsDimension="time" value="4"/>
      <LaneChangeTarget><AbsoluteTargetLane value="1"/></LaneChangeTarget>
    </LaneChangeAction></LateralAction>"""
    brake = """<LongitudinalAction><SpeedAction>
      <SpeedActionDynamics dynamicsShape="linear" dynamicsDimension="rate" value="2"/>
      <SpeedActionTarget><AbsoluteTargetSpeed value="4"/></SpeedActionTarget>
    </SpeedAction></LongitudinalAction>"""
    init = f"""<Private entityRef="Ego"><PrivateAction><TeleportAction><Position>{lane}</Position>
      </TeleportAction></PrivateAction></Private>{_start_at_speed("Ego", 10)}"""
    groups = _act(change, 1.0), _act(brake, 6.0)
    path = write_openscenario(tmp_path, body=_story(*groups, init=init))
    (ego,) = read_scenario(path).tracks
    y = np.interp([1.0, 3.0, 5.0], ego.times_s, ego.places[:, 1])
    # At 3 s the rear axle is between the lanes, and moves aside with pi / 2 times the mean speed.
    turned = math.asin(math.pi / 2 * 3.5 / 4 / 10)
    assert y == pytest.approx([-1.75, REAR_AXLE_M * math.sin(turned), 1.75], abs=0.01)
    # 10 m/s for 6 s, less what is driven sideways, then 10 to 4 m/s within 3 s.
    assert ego.times_s[-1] == pytest.approx(9.0)
    assert ego.places[-1, 0] == pytest.approx(20 + REAR_AXLE_M + 60 + 21, abs=0.3)


def test_a_body_comes_from_a_catalogue_within_the_root_alone(tmp_path: Path) -> None:
    folder = tmp_path / "a" / "b"
    folder.mkdir(parents=True)
    path = write_openscenario(folder, body=_story(format_trajectory("Ego", TWO)))
    text = path.read_text()
    begin = text.index("<Vehicle"), text.index("</Vehicle>") + len("</Vehicle>")
    vehicle = (
        text[begin[0] : begin[1]]
        .replace('"$length"', '"$long"')
        .replace(
            '"car">',
            '"car"><ParameterDeclarations><ParameterDeclaration name="long" value="4"/>'
            "</ParameterDeclarations>",
            1,
        )
    )
    (tmp_path / "cars.xosc").write_text(
        f'<OpenSCENARIO><Catalog name="Cars">{vehicle}</Catalog></OpenSCENARIO>'
    )
    assigned = '<ParameterAssignment parameterRef="long" value="5.5"/>'
    reference = f"""<CatalogReference catalogName="Cars" entryName="car"><ParameterAssignments>
      {assigned}</ParameterAssignments></CatalogReference>"""
    text = text[: begin[0]] + reference + text[begin[1] :]
    places = '<CatalogLocations><VehicleCatalog><Directory path="../.."/></VehicleCatalog>'
    path.write_text(text.replace("<CatalogLocations/>", f"{places}</CatalogLocations>"))
    (ego,) = read_scenario(path, root=tmp_path).tracks
    assert ego.size == (5.5, 1.8, 1.5)
    with pytest.raises(DiagnosticsError, match="is outside"):
        read_scenario(path)


def _act(action: str, time_s: float) -> str:
    trigger = (
        f"<StartTrigger><ConditionGroup>{format_start(time_s)}</ConditionGroup></StartTrigger>"
    )
    return f"""<ManeuverGroup name="g"><Actors><EntityRef entityRef="Ego"/></Actors>
      <Maneuver name="m"><Event name="e{time_s}" priority="parallel"><Action name="x">
      <PrivateAction>
      {action}</PrivateAction></Action>{trigger}</Event></Maneuver></ManeuverGroup>"""


def test_entities_whose_names_become_the_same_track_are_refused(tmp_path: Path) -> None:
    path = write_openscenario(tmp_path, body=_story(format_trajectory("Ego", TWO)))
    path.write_text(path.read_text().replace('"Other"', '"a/b"').replace('"Truck"', '"aéb"'))
    with pytest.raises(DiagnosticsError, match="'aéb' and 'a/b' are both the track 'a_b'"):
        read_scenario(path)


def test_all_that_cannot_be_followed_is_listed_at_once(tmp_path: Path) -> None:
    body = _story(KEEP_DISTANCE, format_trajectory("Ego", TWO, start=NEAR_IN_ONE))
    with pytest.raises(DiagnosticsError) as caught:
        read_scenario(write_openscenario(tmp_path, body=body))
    assert len(caught.value.diagnostics) == 2


def test_what_moves_nobody_is_left_out_and_counted(tmp_path: Path) -> None:
    weather = '<GlobalAction><EnvironmentAction name="rain"/></GlobalAction>'
    lights = "<GlobalAction><InfrastructureAction/></GlobalAction>\n" * 75
    init = weather + lights
    path = write_openscenario(tmp_path, body=_story(format_trajectory("Ego", TWO), init=init))
    scenario = read_scenario(path)
    assert [track.id for track in scenario.tracks] == ["Ego"]
    found = {part.name: part for part in scenario.left_out}
    assert found["actions on traffic lights"].count == 75
    assert found["action on the environment"].count == 1
    # Other, Truck and Walker are declared, and put nowhere.
    assert found["entities that are nowhere"].count == 3
    line = found["actions on traffic lights"].line
    assert "<InfrastructureAction/>" in path.read_text().splitlines()[line - 1]


@pytest.mark.parametrize(
    ("text", "expected"),
    {
        "<osm/>": "is not an <OpenSCENARIO> document",
        '<OpenSCENARIO><FileHeader revMajor="0" revMinor="9"/></OpenSCENARIO>': "is version 0.9",
        "<!DOCTYPE x [<!ENTITY a 'b'>]><OpenSCENARIO/>": "has a document type",
        "<OpenSCENARIO>": "is not XML",
    }.items(),
)
def test_another_document_is_refused(text: str, expected: str, tmp_path: Path) -> None:
    path = tmp_path / "a.xosc"
    path.write_text(text)
    with pytest.raises(InputError, match=expected):
        read_scenario(path)

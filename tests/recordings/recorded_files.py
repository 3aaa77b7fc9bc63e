"""Files of recordings with motions that are computed by hand, and the street on which they are.

The street is 400 m long, leads from west to east and climbs by 3 %; its lanes are 3.5 m wide, so
that traffic to the east drives at y = -1.75.

| track | what | motion |
|---|---|---|
| 1 | car, 4.6 x 1.8 m | from x = 50 at 10 m/s, y = -1.75, with 1 m/s² from the start |
| 2 | car, 4.2 x 1.8 m | at 8 m/s from x = 160 to the west, y = 1.75 |
| 3 | truck, 9 x 2.5 m | stands at x = 120, y = -1.75 |
| 4 | pedestrian | at 1.25 m/s from (100, -8) to the north |
"""

from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

RATE_HZ = 25
DURATION_S = 4.0
GRADE = 0.03


class Row(NamedTuple):
    """A sample: metres, degrees counter-clockwise from east."""

    frame: int
    track: str
    x: float
    y: float
    heading_deg: float


SIZES = {"1": (4.6, 1.8), "2": (4.2, 1.8), "3": (9.0, 2.5), "4": (0.0, 0.0)}
CLASSES = {"1": "car", "2": "car", "3": "truck_bus", "4": "pedestrian"}

STREET = f"""<?xml version="1.0"?>
<OpenDRIVE>
  <header revMajor="1" revMinor="6" name="" version="1"/>
  <road name="Hill" length="400" id="1" junction="-1">
    <planView><geometry s="0" x="0" y="0" hdg="0" length="400"><line/></geometry></planView>
    <elevationProfile><elevation s="0" a="0" b="{GRADE}" c="0" d="0"/></elevationProfile>
    <lanes><laneSection s="0">
      <left><lane id="1" type="driving"><width sOffset="0" a="3.5" b="0" c="0" d="0"/></lane></left>
      <center><lane id="0" type="none"/></center>
      <right><lane id="-1" type="driving">
        <width sOffset="0" a="3.5" b="0" c="0" d="0"/></lane></right>
    </laneSection></lanes>
  </road>
</OpenDRIVE>
"""


def list_rows() -> Iterator[Row]:
    """List the samples of the recording, track by track."""
    for track in CLASSES:
        for frame in range(int(DURATION_S * RATE_HZ) + 1):
            time_s = frame / RATE_HZ
            x, y, heading = {
                "1": (50 + 10 * time_s + 0.5 * time_s**2, -1.75, 0.0),
                "2": (160 - 8 * time_s, 1.75, 180.0),
                "3": (120.0, -1.75, 0.0),
                "4": (100.0, -8 + 1.25 * time_s, 90.0),
            }[track]
            yield Row(frame, track, x, y, heading)


def write_street(folder: Path) -> Path:
    """Write the map."""
    path = folder / "hill.xodr"
    path.write_text(STREET)
    return path


def write_ind(folder: Path) -> Path:
    """Write the recording in the columns of inD, with the files about it."""
    columns = (
        "recordingId,trackId,frame,trackLifetime,xCenter,yCenter,heading,width,length,xVelocity,"
        "yVelocity,xAcceleration,yAcceleration,lonVelocity,latVelocity,lonAcceleration,"
        "latAcceleration"
    )
    rows = [columns]
    for row in list_rows():
        length, width = SIZES[row.track]
        place = f"{row.x:.5f},{row.y:.5f},{row.heading_deg:.5f},{width},{length}"
        rows.append(f"7,{row.track},{row.frame},{row.frame},{place},0,0,0,0,0,0,0,0")
    meta = ["recordingId,trackId,initialFrame,finalFrame,numFrames,width,length,class"]
    for track, name in CLASSES.items():
        length, width = SIZES[track]
        meta.append(f"7,{track},0,100,101,{width},{length},{name}")
    recording = (
        "recordingId,locationId,frameRate,speedLimit,weekday,startTime,duration,numTracks,"
        "numVehicles,numVRUs,latLocation,lonLocation,xUtmOrigin,yUtmOrigin,orthoPxToMeter\n"
        f"7,1,{RATE_HZ},13.88,tuesday,9,4,4,3,1,50.78,6.13,297631,5629917,0.00814\n"
    )
    (folder / "07_tracks.csv").write_text("\n".join(rows) + "\n")
    (folder / "07_tracksMeta.csv").write_text("\n".join(meta) + "\n")
    (folder / "07_recordingMeta.csv").write_text(recording)
    return folder / "07_tracks.csv"


def write_highd(folder: Path) -> Path:
    """Write the vehicles of the recording in the columns of highD, and one column of no format.

    Places are upper left corners with y down; the truck stands on lanes that lead to the left.
    """
    rows = ["frame,id,x,y,width,height,xVelocity,yVelocity,laneId,weather"]
    for row in list_rows():
        if row.track == "4":
            continue
        length, width = SIZES[row.track]
        corner = f"{row.x - length / 2:.5f},{-row.y - width / 2:.5f}"
        rows.append(f"{row.frame},{row.track},{corner},{length},{width},0,0,2,dry")
    directions = {"1": ("Car", 2), "2": ("Car", 1), "3": ("Truck", 1)}
    meta = ["id,width,height,class,drivingDirection"]
    for track, (name, direction) in directions.items():
        meta.append(f"{track},{SIZES[track][0]},{SIZES[track][1]},{name},{direction}")
    (folder / "01_tracks.csv").write_text("\n".join(rows) + "\n")
    (folder / "01_tracksMeta.csv").write_text("\n".join(meta) + "\n")
    (folder / "01_recordingMeta.csv").write_text(f"id,frameRate\n1,{RATE_HZ}\n")
    return folder / "01_tracks.csv"


def write_interaction(folder: Path) -> Path:
    """Write the recording in the columns of INTERACTION: 10 Hz, people in a file of their own."""
    vehicles = ["track_id,frame_id,timestamp_ms,agent_type,x,y,vx,vy,psi_rad,length,width"]
    people = ["track_id,frame_id,timestamp_ms,agent_type,x,y,vx,vy"]
    for row in list_rows():
        if row.frame % 5:
            continue
        head = f"{row.track},{row.frame // 5 + 1},{row.frame * 40}"
        if row.track == "4":
            people.append(f"P{head},pedestrian/bicycle,{row.x:.4f},{row.y:.4f},0,1.25")
            continue
        length, width = SIZES[row.track]
        psi = f"{row.heading_deg * 3.141592653589793 / 180:.9f}"
        vehicles.append(f"{head},car,{row.x:.4f},{row.y:.4f},0,0,{psi},{length},{width}")
    (folder / "pedestrian_tracks_000.csv").write_text("\n".join(people) + "\n")
    path = folder / "vehicle_tracks_000.csv"
    path.write_text("\n".join(vehicles) + "\n")
    return path


REAR_AXLE_M = 1.4
"""Distance of the centre of a car's box from the rear axle, to which positions refer."""


def write_openscenario(folder: Path, *, body: str | None = None) -> Path:
    """Write the recording as OpenSCENARIO, with `hill.xodr`; `body` replaces the storyboard.

    The ego begins a second late, by a trigger; the truck has a place alone. Vertices are 0.5 s
    apart, and positions are those of rear axles.
    """
    path = folder / "crash.xosc"
    path.write_text(_SCENARIO.replace("STORYBOARD", body or _format_storyboard()))
    return path


def format_trajectory(name: str, vertices: str, *, start: str = "", timing: str = "") -> str:
    """Format a maneuver group in which an entity follows vertices by time."""
    timing = timing or '<Timing domainAbsoluteRelative="relative" scale="1" offset="0"/>'
    trigger = f"<StartTrigger><ConditionGroup>{start}</ConditionGroup></StartTrigger>"
    return f"""<ManeuverGroup name="{name}" maximumExecutionCount="1">
      <Actors selectTriggeringEntities="false"><EntityRef entityRef="{name}"/></Actors>
      <Maneuver name="{name}"><Event name="{name}" priority="parallel">
        <Action name="{name}"><PrivateAction><RoutingAction><FollowTrajectoryAction>
          <TrajectoryRef><Trajectory name="{name}" closed="false"><Shape>
            <Polyline>{vertices}</Polyline></Shape></Trajectory></TrajectoryRef>
          <TimeReference>{timing}</TimeReference>
          <TrajectoryFollowingMode followingMode="position"/>
        </FollowTrajectoryAction></RoutingAction></PrivateAction></Action>
        {trigger if start else ""}
      </Event></Maneuver></ManeuverGroup>"""


def format_vertex(time_s: float, x: float, y: float, h: float) -> str:
    """Format a vertex of a polyline."""
    place = f'<WorldPosition x="{x:.6f}" y="{y:.6f}" h="{h:.9f}"/>'
    return f'<Vertex time="{time_s}"><Position>{place}</Position></Vertex>'


def format_start(time_s: float) -> str:
    """Format a condition on the time."""
    time = f'<SimulationTimeCondition value="{time_s}" rule="greaterThan"/>'
    value = f"<ByValueCondition>{time}</ByValueCondition>"
    return f'<Condition name="t" delay="0" conditionEdge="none">{value}</Condition>'


def format_teleport(name: str, x: float, y: float, h: float) -> str:
    """Format where an entity begins."""
    place = f'<WorldPosition x="{x}" y="{y}" h="{h}"/>'
    action = f"<TeleportAction><Position>{place}</Position></TeleportAction>"
    return f'<Private entityRef="{name}"><PrivateAction>{action}</PrivateAction></Private>'


def _format_storyboard() -> str:
    ego = [(t / 2, 50 + 10 * t / 2 + 0.5 * (t / 2) ** 2) for t in range(9)]
    groups = (
        format_trajectory(
            "Ego",
            "".join(format_vertex(t, x - REAR_AXLE_M, -1.75, 0.0) for t, x in ego),
            start=format_start(1.0),
        ),
        format_trajectory(
            "Other",
            "".join(
                format_vertex(t / 2, 160 - 4 * t + REAR_AXLE_M, 1.75, 3.141592654)
                for t in range(11)
            ),
        ),
        format_trajectory(
            "Walker",
            "".join(format_vertex(5.0 * t, 100.0, -8 + 6.25 * t, 1.570796327) for t in range(2)),
        ),
    )
    init = "".join(
        (
            format_teleport("Ego", 50 - REAR_AXLE_M, -1.75, 0),
            format_teleport("Truck", 120 - 2, -1.75, 0),
        )
    )
    return f"""<Init><Actions>{init}</Actions></Init>
    <Story name="s"><Act name="a">{"".join(groups)}
      <StartTrigger><ConditionGroup>{format_start(0)}</ConditionGroup></StartTrigger>
    </Act></Story><StopTrigger/>"""


_BOX = """<BoundingBox><Center x="{0}" y="0" z="0.8"/>
  <Dimensions length="{1}" width="{2}" height="{3}"/></BoundingBox>"""
_CAR_BOX = _BOX.format(REAR_AXLE_M, "$length", 1.8, 1.5)
_SCENARIO = f"""<?xml version="1.0" encoding="utf-8"?>
<OpenSCENARIO>
  <FileHeader revMajor="1" revMinor="2" date="2026-01-01T00:00:00" description="" author=""/>
  <ParameterDeclarations>
    <ParameterDeclaration name="length" parameterType="double" value="4.6"/>
  </ParameterDeclarations>
  <CatalogLocations/>
  <RoadNetwork><LogicFile filepath="hill.xodr"/></RoadNetwork>
  <Entities>
    <ScenarioObject name="Ego">
      <Vehicle name="car" vehicleCategory="car">{_CAR_BOX}</Vehicle></ScenarioObject>
    <ScenarioObject name="Other">
      <Vehicle name="car" vehicleCategory="car">{_CAR_BOX}</Vehicle></ScenarioObject>
    <ScenarioObject name="Truck">
      <Vehicle name="bus" vehicleCategory="bus">{_BOX.format(2, 9, 2.5, 3)}</Vehicle>
    </ScenarioObject>
    <ScenarioObject name="Walker"><Pedestrian name="p" mass="80" pedestrianCategory="pedestrian">
      {_BOX.format(0, 0.5, 0.5, 1.7)}</Pedestrian></ScenarioObject>
  </Entities>
  <Storyboard>STORYBOARD</Storyboard>
</OpenSCENARIO>
"""

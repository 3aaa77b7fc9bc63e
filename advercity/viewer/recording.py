"""Sends a run frame by frame to Rerun: to a file, to connecting viewers, or to a running viewer.

Sinks are checked first: Rerun itself only logs taken ports and missing viewers, and goes on.
"""

import math
import socket
from collections.abc import Generator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Self
from urllib.parse import urlsplit

import rerun as rr
from advercity_dsl import Spec
from advercity_dsl.registry import load_named
from advercity_dsl.sensor_kinds import load_sensor_kinds

from advercity.conflicts.events import ConflictEvent
from advercity.errors import InputError, RunError, describe_cause
from advercity.geometry import poses
from advercity.output_files import check_output, open_output
from advercity.physics.atmosphere import LandUse
from advercity.physics.timeline import WeatherTimeline
from advercity.roads.lane_segments import LaneSegment
from advercity.run_options import CloudColour
from advercity.sensors.annotation import annotate_actors
from advercity.sensors.sensor_frame import SensorFrame
from advercity.viewer import archetypes, blueprint
from advercity.viewer.archetypes import (
    AgentTrack,
    LocalGeoMap,
    PlaneMap,
    TileMap,
    choose_agent_colour,
)
from advercity.viewer.private_page import LOOPBACK_ADDRESS
from advercity.viewer.shown import Curve, Place, Points, Shown
from advercity.viewer.viewer_process import DEFAULT_PORT, check_port

CONNECT_TIMEOUT_S = 3.0
APPLICATION_ID = "advercity"
DRIVEN_PX, PLANNED_PX = 2.5, 1.2
CONFLICT_MARK_COLOUR, CONFLICT_MARK_RADIUS_M, CONFLICT_MARK_HEIGHT_M = (255, 60, 60), 0.6, 2.5


def compute_weather_quantities(
    timeline: WeatherTimeline, land_use: LandUse, frame: int
) -> dict[str, float]:
    """Compute the plotted quantities of a frame's weather, by name with the unit at its end.

    The visibility is the meteorological optical range; it is absent if nothing limits it. The
    illuminance is on level ground in the open: sun, sky and street lamps.
    """
    weather, atmosphere = timeline.weather_at(frame), timeline.atmosphere_at(frame, land_use)
    quantities = {
        "visibility_m": atmosphere.mor_m,
        "rain_mm_h": weather.rain.rate_mm_h,
        "snow_mm_h": weather.snow.rate_mm_h,
        "illuminance_lx": atmosphere.ground_lx + atmosphere.street_lx,
        "wetness": atmosphere.wetness,
    }
    return {name: value for name, value in quantities.items() if math.isfinite(value)}


def check_recording_file(path: Path) -> None:
    """Raise an InputError if a file is no recording by its name, or may not be replaced."""
    if path.is_dir() or path.suffix != ".rrd":
        # A file with another suffix may be a spec, after an option for a file.
        what = "is a folder" if path.is_dir() else "is no name of a recording"
        raise InputError(f"{path}: {what}; name a file ending in .rrd")
    check_output(path)


@contextmanager
def open_recording_file(path: Path) -> Generator[Path]:
    """Yield the path of an incomplete recording; at the end it becomes `path`.

    Raises:
        InputError: The name is no recording's, or a file of this name may not be replaced.
        RunError: The file cannot be written.
    """
    check_recording_file(path)
    try:
        with open_output(path) as partial:
            partial.touch()
            yield partial
    except OSError as error:
        raise RunError(f"{path}: cannot be written: {describe_cause(error)}") from error


def start_server_sink(port: int) -> rr.GrpcServerSink:
    """Start a server for viewers on this machine only; RunError if the port is taken."""
    check_port(port, f"close it, or send to it with `connect` {LOOPBACK_ADDRESS}:{port}")
    return rr.GrpcServerSink(LOOPBACK_ADDRESS, port)


def parse_viewer_address(address: str) -> tuple[str, tuple[str, int]]:
    """Parse `host:port` or a whole `rerun+http://host:port/proxy` into URL, and host and port.

    Raises:
        InputError: `address` is neither.
    """
    url = address if "://" in address else f"rerun+http://{address}/proxy"
    try:
        rr.GrpcSink(url)
        parts = urlsplit(url)
        return url, (parts.hostname or LOOPBACK_ADDRESS, parts.port or DEFAULT_PORT)
    except (RuntimeError, ValueError) as error:
        raise InputError(
            f"{address}: not an address of a Rerun viewer; write host:port: {error}"
        ) from error


def connect_viewer_sink(address: str) -> rr.GrpcSink:
    """Connect to a running viewer at an address of `parse_viewer_address`.

    Raises:
        InputError: `address` is none.
        RunError: No viewer answers.
    """
    url, endpoint = parse_viewer_address(address)
    try:
        socket.create_connection(endpoint, timeout=CONNECT_TIMEOUT_S).close()
    except OSError as error:
        raise RunError(f"{address}: no Rerun viewer answers; start one with: rerun") from error
    return rr.GrpcSink(url)


class RerunRecording:
    """Sends the sensor frames of a run to Rerun; a context manager.

    It goes to an `.rrd` file, to viewers on this machine through a server at `address`, and to a
    running viewer at `connect` (`host:port`, or a whole `rerun+http://` address), in any
    combination. The recording's id is the spec's, so a viewer adds a resumed run to the frames it
    has. Events of conflicts are logged at their frames. With `map_tiles`, receivers are on a map
    whose tiles a viewer takes from the Internet, otherwise on the road's plan.

    Raises:
        InputError: `connect` is not an address.
        RunError: The file cannot be written, the port is taken, or no viewer answers.
    """

    def __init__(
        self,
        spec: Spec,
        lanes: Sequence[LaneSegment],
        *,
        file: Path | None = None,
        serve: bool = False,
        port: int = DEFAULT_PORT,
        connect: str | None = None,
        cloud_colour: CloudColour = "intensity",
        map_tiles: bool = False,
        events: Sequence[ConflictEvent] = (),
    ) -> None:
        viewers = () if connect is None else (connect_viewer_sink(connect),)
        self._servers = (start_server_sink(port),) if serve else ()
        self._output = ExitStack()
        self._file = None if file is None else self._output.enter_context(open_recording_file(file))
        files = () if self._file is None else (rr.FileSink(str(self._file)),)
        self._stream = rr.RecordingStream(
            APPLICATION_ID, recording_id=spec.id, send_properties=False
        )
        self._stream.set_log_time_enabled(False)  # the same run gives the same recording
        self._stream.set_sinks(*files, *viewers, *self._servers)
        self._cloud_colour: CloudColour = cloud_colour
        self._events = tuple(events)
        self._timeline = WeatherTimeline.from_spec(spec)
        self._land_use: LandUse = spec.road.land_use
        around = LocalGeoMap.around_road(spec.road)
        self._map = TileMap(around) if map_tiles else PlaneMap(around)
        self._map_tiles = map_tiles
        self._tracks = {
            agent.id: AgentTrack(choose_agent_colour(index))
            for index, agent in enumerate(spec.recorded_agents)
        }
        self._has_blueprint = False
        self._stream.send_recording_name(spec.id)
        self._log_static_scene(spec, lanes)

    @property
    def address(self) -> str | None:
        """Address of the server; None without one."""
        return self._servers[0].uri if self._servers else None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: object, error: BaseException | None, traceback: object) -> None:
        self._stream.flush()
        self._stream.disconnect()
        with self._output:
            if error is not None and self._file is not None:
                self._file.unlink(missing_ok=True)

    def log_frame(self, sensor_frames: Sequence[SensorFrame]) -> None:
        """Log one frame, given the sensor frames of all agents."""
        shown = [list_shown(item, self._cloud_colour) for item in sensor_frames]
        if not self._has_blueprint:
            self._send_blueprint(sensor_frames, shown)
        frame = sensor_frames[0].frame
        self._stream.set_time(blueprint.TIMELINE, sequence=frame.index)
        self._stream.set_time("time", duration=frame.time_s)
        annotated = {one.state.actor.id for item in sensor_frames for one in annotate_actors(item)}
        for path, wanted in ((blueprint.ANNOTATED_ACTORS, True), (blueprint.OTHER_ACTORS, False)):
            states = [state for state in frame.states if (state.actor.id in annotated) == wanted]
            self._stream.log(path, archetypes.to_boxes3d(states))
        for item, its_own in zip(sensor_frames, shown, strict=True):
            self._log_sensors(item, its_own)
            if item.agent.place.kind == "vehicle":
                self._log_trajectory(item)
        quantities = compute_weather_quantities(self._timeline, self._land_use, frame.index)
        for name, value in quantities.items():
            self._stream.log(blueprint.format_weather_path(name), rr.Scalars(value))
        self._log_events(frame.index, ground_m=float(sensor_frames[0].world_from_agent[2, 3]))

    def _send_blueprint(
        self, sensor_frames: Sequence[SensorFrame], shown: Sequence[Sequence[Shown]]
    ) -> None:
        # With the first frame, because the eye starts at the first agent's pose.
        agents = [item.agent for item in sensor_frames]
        made = blueprint.build_blueprint(
            agents, shown, sensor_frames[0].world_from_agent, self._map_tiles
        )
        self._stream.send_blueprint(made)
        for agent, its_own in zip(agents, shown, strict=True):
            for one in its_own:
                if isinstance(one, Curve) and one.axes:
                    lines = rr.SeriesLines(names=[f"{agent.id} {axis}" for axis in one.axes])
                    path = blueprint.format_plot_path(one.quantity, agent)
                    self._stream.log(path, lines, static=True)
        self._has_blueprint = True

    def _log_static_scene(self, spec: Spec, lanes: Sequence[LaneSegment]) -> None:
        self._stream.log("world", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
        self._stream.log("world/actors", archetypes.build_annotation_context(), static=True)
        self._stream.log(blueprint.ROAD, archetypes.to_lane_strips(lanes), static=True)
        self._stream.log(blueprint.MAP_ROAD, self._map.to_lane_lines(lanes), static=True)

    def _log_sensors(self, item: SensorFrame, shown: Sequence[Shown]) -> None:
        """Log the shown data of an agent's sensors, below the agent if it is in the scene."""
        log, agent = self._stream.log, item.agent
        agent_from_world = poses.invert_pose(item.world_from_agent)
        log(blueprint.format_agent_path(agent), archetypes.to_transform3d(item.world_from_agent))
        for one in shown:
            if isinstance(one, Curve):
                log(blueprint.format_plot_path(one.quantity, agent), rr.Scalars(one.value))
            elif isinstance(one, Place):
                self._log_place(item, one)
            else:
                path = blueprint.format_sensor_path(agent, one)
                if one.pose is not None:
                    log(path, archetypes.to_transform3d(agent_from_world @ one.pose))
                if isinstance(one, Points):
                    log(path, archetypes.to_points3d(one))
                    continue
                if one.model is not None:
                    log(path, archetypes.build_pinhole(one.model))
                log(path, archetypes.to_encoded_image(one))

    def _log_place(self, item: SensorFrame, place: Place) -> None:
        """Log where an agent's receiver takes itself to be, and all its former places."""
        track, path = self._tracks[item.agent.id], f"map/{item.agent.id}"
        track.fixes.append((place.latitude_deg, place.longitude_deg))
        self._stream.log(path, self._map.to_point(track.fixes[-1], track.colour))
        self._stream.log(f"{path}/track", self._map.to_line(track.fixes, track.colour))

    def _log_trajectory(self, item: SensorFrame) -> None:
        """Log the past and the planned trajectory of a vehicle, and its speed."""
        log, agent, track = self._stream.log, item.agent, self._tracks[item.agent.id]
        east, north, up = (float(value) for value in item.world_from_agent[:3, 3])
        track.driven.append((east, north, up))
        log(blueprint.format_plot_path("speed", agent), rr.Scalars(item.speed_m_s))
        # The plan has no heights; the vehicle's own keeps it visible on a slope.
        planned = [(east, north, up), *((x, y, up) for x, y, _ in item.planned_trajectory)]
        for name, points, width_px in (
            ("driven", track.driven, DRIVEN_PX),
            ("planned", planned, PLANNED_PX),
        ):
            strip = archetypes.to_line_strip(points, track.colour, width_px)
            log(f"world/trajectories/{name}/{agent.id}", strip)

    def _log_events(self, frame: int, *, ground_m: float) -> None:
        """Log the events of a frame as text, and mark their conflict points from then on."""
        for event in self._events:
            if event.frame == frame:
                level = rr.TextLogLevel.WARN if event.is_failure else rr.TextLogLevel.INFO
                self._stream.log(blueprint.EVENTS, rr.TextLog(event.text, level=level))
                mark = rr.Points3D(
                    [(*event.point_m, ground_m + CONFLICT_MARK_HEIGHT_M)],
                    labels=[event.text],
                    show_labels=False,  # a text over the scene; the list of conflicts has it
                    colors=CONFLICT_MARK_COLOUR,
                    radii=CONFLICT_MARK_RADIUS_M,
                )
                self._stream.log(blueprint.CONFLICTS, mark)


def list_shown(item: SensorFrame, colouring: CloudColour) -> list[Shown]:
    """List the shown data of all measurements of an agent."""
    return [
        shown
        for kind in load_sensor_kinds().found.values()
        if kind.show
        for number in range(len(item.readings.get(kind.name, ())))
        for shown in load_named(kind.show)(item, number, colouring)
    ]

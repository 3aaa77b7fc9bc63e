"""The weather in figures, as it is plotted.

Where a recording goes, checked before anything is sent.

Rerun itself only logs that a port is taken or that nobody listens, and goes on without an audience.

A live or stored Rerun view of a scenario, frame by frame while it is made.
"""

import math
import socket
from collections.abc import Sequence
from pathlib import Path
from types import TracebackType
from typing import Self
from urllib.parse import urlsplit

import numpy as np
import rerun as rr
from advercity_dsl import Agent, Spec
from numpy.typing import NDArray

from advercity.conflicts.report import ConflictEvent
from advercity.dataset.image_codec import encode_jpeg, encode_label_png, to_semantic_colours
from advercity.errors import InputError, RunError
from advercity.geometry import poses
from advercity.physics.atmosphere import compute_atmosphere
from advercity.roads.lane_segments import LaneSegment
from advercity.sensors.annotation import annotate_actors
from advercity.sensors.sensor_frame import SensorFrame
from advercity.viewer import archetypes, blueprint
from advercity.viewer.archetypes import (
    AgentTrack,
    LocalGeoMap,
    choose_agent_colour,
    to_geo_line,
    to_geo_point,
)
from advercity.viewer.cloud_colours import CloudColour


def compute_weather_quantities(spec: Spec) -> dict[str, float]:
    """What the weather of a spec comes to, by quantity with its unit.

    The visibility (meteorological optical range) is left out where nothing limits it. The
    illuminance is that of level ground in the open: sun, sky and street lamps.
    """
    weather = spec.weather
    atmosphere = compute_atmosphere(weather, spec.road.land_use)
    found = {
        "visibility_m": atmosphere.mor_m,
        "rain_mm_h": weather.rain.rate_mm_h,
        "snow_mm_h": weather.snow.rate_mm_h,
        "illuminance_lx": atmosphere.ground_lx + atmosphere.street_lx,
        "wetness": atmosphere.wetness,
    }
    return {name: value for name, value in found.items() if math.isfinite(value)}


LOOPBACK_ADDRESS = "127.0.0.1"
DEFAULT_PORT = 9876
CONNECT_TIMEOUT_S = 3.0


def open_file_sink(path: Path) -> rr.FileSink:
    """A recording that grows in `partial_of(path)`, for whoever closes it to move to `path`.

    Raises:
        InputError: `path` is a folder.
        RunError: It cannot be written.
    """
    if path.is_dir():
        raise InputError(f"{path}: is a folder; name a file that ends in .rrd")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        partial_path(path).open("wb").close()
    except OSError as error:
        raise RunError(f"{path}: cannot be written: {error.strerror}") from error
    return rr.FileSink(str(partial_path(path)))


def partial_path(path: Path) -> Path:
    """Where a recording lies while it is not whole."""
    return path.with_name(f"{path.name}.partial")


def start_server_sink(port: int) -> rr.GrpcServerSink:
    """A server for viewers on this machine, and only for them; RunError if the port is taken."""
    try:
        with socket.socket() as probe:
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            probe.bind((LOOPBACK_ADDRESS, port))
    except OSError as error:
        raise RunError(
            f"port {port} is taken, perhaps by a Rerun viewer; close it, or send to it with"
            f" --connect {LOOPBACK_ADDRESS}:{port}"
        ) from error
    return rr.GrpcServerSink(LOOPBACK_ADDRESS, port)


def connect_viewer_sink(address: str) -> rr.GrpcSink:
    """A running viewer.

    Args:
        address: `host:port` or a whole `rerun+http://host:port/proxy`.

    Raises:
        InputError: `address` is neither.
        RunError: Nobody listens there.
    """
    url = address if "://" in address else f"rerun+http://{address}/proxy"
    try:
        sink = rr.GrpcSink(url)
        parts = urlsplit(url)
        host, port = parts.hostname or LOOPBACK_ADDRESS, parts.port or DEFAULT_PORT
    except (RuntimeError, ValueError) as error:
        raise InputError(
            f"{address}: not an address of a Rerun viewer; write host:port: {error}"
        ) from error
    try:
        socket.create_connection((host, port), timeout=CONNECT_TIMEOUT_S).close()
    except OSError as error:
        raise RunError(f"{address}: no Rerun viewer answers; start one with: rerun") from error
    return sink


APPLICATION_ID = "advercity"
DRIVEN_PX, PLANNED_PX = 2.5, 1.2
CONFLICT_MARK_COLOUR, CONFLICT_MARK_RADIUS_M, CONFLICT_MARK_HEIGHT_M = (255, 60, 60), 0.6, 2.5


class RerunRecording:
    """Sends what a run reads to a file, to whoever connects, or to a running viewer.

    A context manager; several of the three may be asked for at once. The recording's id is the
    spec's, so a viewer adds a resumed run to what it has.

    Args:
        spec: What is run.
        lanes: The road plan.
        file: `.rrd` file to write.
        serve: Be a server that viewers on this machine connect to, at `address`, until closed.
        port: Of that server.
        connect: Address of a running viewer: `host:port`, or a whole `rerun+http://` address.
        cloud_colour: What the colours of points stand for.
        events: What is told of when its frame is shown.

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
        events: Sequence[ConflictEvent] = (),
    ) -> None:
        self._file = file
        files = () if file is None else (open_file_sink(file),)
        viewers = () if connect is None else (connect_viewer_sink(connect),)
        self._servers = (start_server_sink(port),) if serve else ()
        self._stream = rr.RecordingStream(
            APPLICATION_ID, recording_id=spec.id, send_properties=False
        )
        self._stream.set_log_time_enabled(False)
        self._stream.set_sinks(*files, *viewers, *self._servers)
        self._cloud_colour: CloudColour = cloud_colour
        self._events = tuple(events)
        self._weather_quantities = compute_weather_quantities(spec)
        self._map = LocalGeoMap.around_road(spec.road)
        self._tracks = {
            agent.id: AgentTrack(choose_agent_colour(index))
            for index, agent in enumerate(spec.agents)
        }
        self._has_blueprint = False
        self._stream.send_recording_name(spec.id)
        self._log_static_scene(spec, lanes)

    @property
    def address(self) -> str | None:
        """Where a viewer finds the server; None if there is none."""
        return self._servers[0].uri if self._servers else None

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self._stream.flush()
        self._stream.disconnect()
        if self._file is not None:
            if error is None:
                partial_path(self._file).replace(self._file)
            else:
                partial_path(self._file).unlink(missing_ok=True)

    def log_frame(self, sensor_frames: Sequence[SensorFrame]) -> None:
        """Show one frame: the readings of all its viewpoints."""
        if not self._has_blueprint:
            self._send_blueprint(sensor_frames)
        frame = sensor_frames[0].frame
        self._stream.set_time(blueprint.TIMELINE, sequence=frame.index)
        self._stream.set_time("time", duration=frame.time_s)
        seen = {
            item.state.actor.id for reading in sensor_frames for item in annotate_actors(reading)
        }
        for path, wanted in ((blueprint.ANNOTATED_ACTORS, True), (blueprint.OTHER_ACTORS, False)):
            states = [state for state in frame.states if (state.actor.id in seen) == wanted]
            self._stream.log(path, archetypes.to_boxes3d(states))
        for reading in sensor_frames:
            self._log_viewpoint(reading)
            self._log_motion(reading)
            if reading.agent.place.kind == "vehicle":
                self._log_trajectory(reading)
        for name, value in self._weather_quantities.items():
            self._stream.log(blueprint.format_weather_path(name), rr.Scalars(value))
        self._log_events(frame.index, ground_m=float(sensor_frames[0].world_from_agent[2, 3]))

    def _send_blueprint(self, readings: Sequence[SensorFrame]) -> None:
        """Only the first frame tells where to look."""
        agents = [reading.agent for reading in readings]
        self._stream.send_blueprint(blueprint.build_blueprint(agents, readings[0].world_from_agent))
        self._has_blueprint = True

    def _log_static_scene(self, spec: Spec, lanes: Sequence[LaneSegment]) -> None:
        self._stream.log("world", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
        self._stream.log("world/actors", archetypes.build_annotation_context(), static=True)
        self._stream.log(blueprint.ROAD, archetypes.to_lane_strips(lanes), static=True)
        self._stream.log(blueprint.MAP_ROAD, self._map.to_lane_lines(lanes), static=True)
        for agent in spec.agents:
            if agent.sensors.imu is not None:
                self._log_curve_names(agent)

    def _log_curve_names(self, agent: Agent) -> None:
        curves = rr.SeriesLines(names=[f"{agent.id} {axis}" for axis in ("ahead", "left", "up")])
        for quantity in ("acceleration", "turn_rate"):
            self._stream.log(blueprint.format_plot_path(quantity, agent), curves, static=True)

    def _log_viewpoint(self, reading: SensorFrame) -> None:
        agent = reading.agent
        agent_from_world = poses.invert_pose(reading.world_from_agent)
        self._stream.log(
            blueprint.format_agent_path(agent), archetypes.to_transform3d(reading.world_from_agent)
        )
        lidar = blueprint.format_lidar_path(agent)
        self._stream.log(
            lidar, archetypes.to_transform3d(agent_from_world @ reading.world_from_lidar)
        )
        self._stream.log(lidar, archetypes.to_points3d(reading, self._cloud_colour))
        field_of_view = agent.sensors.camera.horizontal_fov_deg
        for index, picture in enumerate(reading.camera_images):
            camera = blueprint.format_camera_path(agent, index)
            self._stream.log(
                camera, archetypes.to_transform3d(agent_from_world @ picture.world_from_camera)
            )
            self._stream.log(
                camera, archetypes.to_pinhole(picture, horizontal_fov_deg=field_of_view)
            )
            image = rr.EncodedImage(contents=encode_jpeg(picture.image), media_type="image/jpeg")
            self._stream.log(camera, image)
            content = encode_label_png(to_semantic_colours(picture.semantic))
            semantic = rr.EncodedImage(contents=content, media_type="image/png")
            self._stream.log(blueprint.format_semantic_path(agent, index), semantic)

    def _log_trajectory(self, reading: SensorFrame) -> None:
        """Where a vehicle has been, is about to go, and where its receiver says that it is."""
        agent, track = reading.agent, self._tracks[reading.agent.id]
        x, y, z = (float(value) for value in reading.world_from_agent[:3, 3])
        track.driven.append((x, y, z))
        planned = [(x, y, z), *((ahead, left, z) for ahead, left, _ in reading.planned_trajectory)]
        driven = archetypes.to_line_strip(track.driven, track.colour, DRIVEN_PX)
        self._stream.log(blueprint.format_driven_path(agent), driven)
        self._stream.log(
            blueprint.format_planned_path(agent),
            archetypes.to_line_strip(planned, track.colour, PLANNED_PX),
        )
        if reading.gnss is not None:
            track.fixes.append((reading.gnss.latitude_deg, reading.gnss.longitude_deg))
            path = blueprint.format_map_path(agent)
            self._stream.log(path, to_geo_point(track.fixes[-1], track.colour))
            self._stream.log(f"{path}/track", to_geo_line(track.fixes, track.colour))

    def _log_events(self, frame: int, *, ground_m: float) -> None:
        """Conflicts are told in words, and where their ways meet stands a mark from then on."""
        for event in self._events:
            if event.frame == frame:
                level = rr.TextLogLevel.WARN if event.is_failure else rr.TextLogLevel.INFO
                self._stream.log(blueprint.EVENTS, rr.TextLog(event.text, level=level))
                place = (*event.point_m, ground_m + CONFLICT_MARK_HEIGHT_M)
                self._stream.log(
                    blueprint.CONFLICTS,
                    rr.Points3D(
                        [place],
                        labels=[event.text],
                        colors=CONFLICT_MARK_COLOUR,
                        radii=CONFLICT_MARK_RADIUS_M,
                    ),
                )

    def _log_motion(self, reading: SensorFrame) -> None:
        if reading.agent.place.kind == "vehicle":
            self._plot(reading, "speed", reading.speed_m_s)
        if reading.gnss is not None:
            self._plot(reading, "latitude", reading.gnss.latitude_deg)
            self._plot(reading, "longitude", reading.gnss.longitude_deg)
            self._plot(reading, "altitude", reading.gnss.altitude_m)
        if reading.imu is not None:
            self._plot(reading, "acceleration", reading.imu.specific_force)
            self._plot(reading, "turn_rate", reading.imu.angular_rate)

    def _plot(
        self, reading: SensorFrame, quantity: str, value: float | NDArray[np.float64]
    ) -> None:
        self._stream.log(blueprint.format_plot_path(quantity, reading.agent), rr.Scalars(value))

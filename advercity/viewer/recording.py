"""A live or stored Rerun view of a scenario, frame by frame while it is made."""

from collections.abc import Sequence
from pathlib import Path
from types import TracebackType
from typing import Self

import numpy as np
import rerun as rr
from advercity_dsl import Agent, Spec
from numpy.typing import NDArray

from advercity import poses
from advercity.dataset.annotation import annotate
from advercity.dataset.images import jpeg, painted
from advercity.dataset.png import label_png
from advercity.dataset.reading import Reading
from advercity.viewer import layout, shapes
from advercity.viewer.ambience import ambience
from advercity.viewer.clouds import CloudColour
from advercity.viewer.events import Event
from advercity.viewer.maps import LocalMap, Track, colour_of, map_line, map_point
from advercity.viewer.sinks import PORT, connection_to, file_at, partial_of, server_on
from advercity.world.scene import Lane

APPLICATION = "advercity"
DRIVEN_PX, PLANNED_PX = 2.5, 1.2
MARK, MARK_RADIUS_M, MARK_ABOVE_M = (255, 60, 60), 0.6, 2.5


class Recording:
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
        lanes: Sequence[Lane],
        *,
        file: Path | None = None,
        serve: bool = False,
        port: int = PORT,
        connect: str | None = None,
        cloud_colour: CloudColour = "intensity",
        events: Sequence[Event] = (),
    ) -> None:
        self._file = file
        files = () if file is None else (file_at(file),)
        viewers = () if connect is None else (connection_to(connect),)
        self._servers = (server_on(port),) if serve else ()
        self._stream = rr.RecordingStream(APPLICATION, recording_id=spec.id, send_properties=False)
        self._stream.set_log_time_enabled(False)
        self._stream.set_sinks(*files, *viewers, *self._servers)
        self._cloud_colour: CloudColour = cloud_colour
        self._events = tuple(events)
        self._ambience = ambience(spec)
        self._map = LocalMap.of(spec.road)
        self._tracks = {
            agent.id: Track(colour_of(index)) for index, agent in enumerate(spec.agents)
        }
        self._is_laid_out = False
        self._stream.send_recording_name(spec.id)
        self._log_stage(spec, lanes)

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
                partial_of(self._file).replace(self._file)
            else:
                partial_of(self._file).unlink(missing_ok=True)

    def log(self, readings: Sequence[Reading]) -> None:
        """Show one frame: the readings of all its viewpoints."""
        if not self._is_laid_out:
            self._lay_out(readings)
        frame = readings[0].frame
        self._stream.set_time(layout.TIMELINE, sequence=frame.index)
        self._stream.set_time("time", duration=frame.time_s)
        seen = {item.state.actor.id for reading in readings for item in annotate(reading)}
        for path, wanted in ((layout.ACTORS_SEEN, True), (layout.ACTORS_UNSEEN, False)):
            states = [state for state in frame.states if (state.actor.id in seen) == wanted]
            self._stream.log(path, shapes.boxes(states))
        for reading in readings:
            self._log_viewpoint(reading)
            self._log_motion(reading)
            if reading.agent.place.kind == "vehicle":
                self._log_trajectory(reading)
        for name, value in self._ambience.items():
            self._stream.log(layout.weather_path(name), rr.Scalars(value))
        self._log_events(frame.index, ground_m=float(readings[0].world_from_agent[2, 3]))

    def _lay_out(self, readings: Sequence[Reading]) -> None:
        """Only the first frame tells where to look."""
        agents = [reading.agent for reading in readings]
        self._stream.send_blueprint(layout.blueprint(agents, readings[0].world_from_agent))
        self._is_laid_out = True

    def _log_stage(self, spec: Spec, lanes: Sequence[Lane]) -> None:
        self._stream.log("world", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
        self._stream.log("world/actors", shapes.class_names(), static=True)
        self._stream.log(layout.ROAD, shapes.road(lanes), static=True)
        self._stream.log(layout.MAP_ROAD, self._map.road(lanes), static=True)
        for agent in spec.agents:
            if agent.sensors.imu is not None:
                self._name_curves(agent)

    def _name_curves(self, agent: Agent) -> None:
        curves = rr.SeriesLines(names=[f"{agent.id} {axis}" for axis in ("ahead", "left", "up")])
        for quantity in ("acceleration", "turn_rate"):
            self._stream.log(layout.plot_path(quantity, agent), curves, static=True)

    def _log_viewpoint(self, reading: Reading) -> None:
        agent = reading.agent
        agent_from_world = poses.inverse(reading.world_from_agent)
        self._stream.log(layout.agent_path(agent), shapes.transform(reading.world_from_agent))
        lidar = layout.lidar_path(agent)
        self._stream.log(lidar, shapes.transform(agent_from_world @ reading.world_from_lidar))
        self._stream.log(lidar, shapes.points(reading, self._cloud_colour))
        field_of_view = agent.sensors.camera.horizontal_fov_deg
        for index, picture in enumerate(reading.pictures):
            camera = layout.camera_path(agent, index)
            self._stream.log(camera, shapes.transform(agent_from_world @ picture.world_from_camera))
            self._stream.log(camera, shapes.pinhole(picture, horizontal_fov_deg=field_of_view))
            image = rr.EncodedImage(contents=jpeg(picture.image), media_type="image/jpeg")
            self._stream.log(camera, image)
            content = label_png(painted(picture.semantic))
            semantic = rr.EncodedImage(contents=content, media_type="image/png")
            self._stream.log(layout.semantic_path(agent, index), semantic)

    def _log_trajectory(self, reading: Reading) -> None:
        """Where a vehicle has been, is about to go, and where its receiver says that it is."""
        agent, track = reading.agent, self._tracks[reading.agent.id]
        x, y, z = (float(value) for value in reading.world_from_agent[:3, 3])
        track.driven.append((x, y, z))
        planned = [(x, y, z), *((ahead, left, z) for ahead, left, _ in reading.planned)]
        driven = shapes.line(track.driven, track.colour, DRIVEN_PX)
        self._stream.log(layout.driven_path(agent), driven)
        self._stream.log(layout.planned_path(agent), shapes.line(planned, track.colour, PLANNED_PX))
        if reading.gnss is not None:
            track.fixes.append((reading.gnss.latitude_deg, reading.gnss.longitude_deg))
            path = layout.map_path(agent)
            self._stream.log(path, map_point(track.fixes[-1], track.colour))
            self._stream.log(f"{path}/track", map_line(track.fixes, track.colour))

    def _log_events(self, frame: int, *, ground_m: float) -> None:
        """Conflicts are told in words, and where their ways meet stands a mark from then on."""
        for event in self._events:
            if event.frame == frame:
                level = rr.TextLogLevel.WARN if event.is_failure else rr.TextLogLevel.INFO
                self._stream.log(layout.EVENTS, rr.TextLog(event.text, level=level))
                place = (*event.point_m, ground_m + MARK_ABOVE_M)
                self._stream.log(
                    layout.CONFLICTS,
                    rr.Points3D([place], labels=[event.text], colors=MARK, radii=MARK_RADIUS_M),
                )

    def _log_motion(self, reading: Reading) -> None:
        if reading.agent.place.kind == "vehicle":
            self._plot(reading, "speed", reading.speed_m_s)
        if reading.gnss is not None:
            self._plot(reading, "latitude", reading.gnss.latitude_deg)
            self._plot(reading, "longitude", reading.gnss.longitude_deg)
            self._plot(reading, "altitude", reading.gnss.altitude_m)
        if reading.imu is not None:
            self._plot(reading, "acceleration", reading.imu.specific_force)
            self._plot(reading, "turn_rate", reading.imu.angular_rate)

    def _plot(self, reading: Reading, quantity: str, value: float | NDArray[np.float64]) -> None:
        self._stream.log(layout.plot_path(quantity, reading.agent), rr.Scalars(value))

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
from advercity.dataset.annotation import annotate, box_centre
from advercity.dataset.images import jpeg, painted, png
from advercity.dataset.reading import Picture, Reading, intrinsic
from advercity.poses import Matrix
from advercity.traffic.trace import ActorState
from advercity.viewer import layout
from advercity.viewer.clouds import CloudColour, colours
from advercity.viewer.sinks import PORT, connection_to, file_at, partial_of, server_on
from advercity.world.scene import Lane

APPLICATION = "advercity"
IMAGE_PLANE_M = 1.5
POINT_PX = 1.5
CLASS_COLOURS = {
    "car": (66, 133, 244),
    "van": (0, 172, 193),
    "truck": (171, 71, 188),
    "bicycle": (124, 179, 66),
    "motorcycle": (255, 179, 0),
    "pedestrian": (229, 57, 53),
}
CLASS_IDS = {name: index for index, name in enumerate(CLASS_COLOURS, start=1)}
LANE_COLOURS = {"driving": (190, 190, 190), "sidewalk": (140, 110, 140), "crossing": (220, 200, 90)}
OTHER_LANE_COLOUR = (110, 110, 110)


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
    ) -> None:
        self._file = file
        files = () if file is None else (file_at(file),)
        viewers = () if connect is None else (connection_to(connect),)
        self._servers = (server_on(port),) if serve else ()
        self._stream = rr.RecordingStream(APPLICATION, recording_id=spec.id, send_properties=False)
        self._stream.set_log_time_enabled(False)
        self._stream.set_sinks(*files, *viewers, *self._servers)
        self._cloud_colour: CloudColour = cloud_colour
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
            self._stream.log(path, _boxes(states))
        for reading in readings:
            self._log_viewpoint(reading)
            self._log_motion(reading)

    def _lay_out(self, readings: Sequence[Reading]) -> None:
        """Only the first frame tells where to look."""
        agents = [reading.agent for reading in readings]
        self._stream.send_blueprint(layout.blueprint(agents, readings[0].world_from_agent))
        self._is_laid_out = True

    def _log_stage(self, spec: Spec, lanes: Sequence[Lane]) -> None:
        self._stream.log("world", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
        classes = [
            rr.AnnotationInfo(id=CLASS_IDS[name], label=name, color=colour)
            for name, colour in CLASS_COLOURS.items()
        ]
        self._stream.log("world/actors", rr.AnnotationContext(classes), static=True)
        self._stream.log(layout.ROAD, _road(lanes), static=True)
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
        self._stream.log(layout.agent_path(agent), _transform(reading.world_from_agent))
        lidar = layout.lidar_path(agent)
        self._stream.log(lidar, _transform(agent_from_world @ reading.world_from_lidar))
        self._stream.log(lidar, _points(reading, self._cloud_colour))
        field_of_view = agent.sensors.camera.horizontal_fov_deg
        for index, picture in enumerate(reading.pictures):
            camera = layout.camera_path(agent, index)
            self._stream.log(camera, _transform(agent_from_world @ picture.world_from_camera))
            self._stream.log(camera, _pinhole(picture, horizontal_fov_deg=field_of_view))
            image = rr.EncodedImage(contents=jpeg(picture.image), media_type="image/jpeg")
            self._stream.log(camera, image)
            content = png(painted(picture.semantic))
            semantic = rr.EncodedImage(contents=content, media_type="image/png")
            self._stream.log(layout.semantic_path(agent, index), semantic)

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


def _transform(parent_from_child: Matrix) -> rr.Transform3D:
    return rr.Transform3D(translation=parent_from_child[:3, 3], mat3x3=parent_from_child[:3, :3])


def _pinhole(picture: Picture, *, horizontal_fov_deg: float) -> rr.Pinhole:
    """Body axes are said to the viewer, so that poses need no turning."""
    height, width = picture.image.shape[:2]
    return rr.Pinhole(
        image_from_camera=intrinsic(picture, horizontal_fov_deg=horizontal_fov_deg),
        resolution=(width, height),
        camera_xyz=rr.ViewCoordinates.FLU,
        image_plane_distance=IMAGE_PLANE_M,
    )


def _points(reading: Reading, by: CloudColour) -> rr.Points3D:
    """Points in the LiDAR's frame."""
    radii = rr.Radius.ui_points(POINT_PX)
    return rr.Points3D(reading.cloud.points, colors=colours(reading.cloud, by), radii=radii)


def _boxes(states: Sequence[ActorState]) -> rr.Boxes3D:
    return rr.Boxes3D(
        centers=np.reshape([box_centre(state) for state in states], (-1, 3)),
        half_sizes=np.reshape([state.actor.size for state in states], (-1, 3)) / 2,
        quaternions=[rr.Quaternion(xyzw=_quaternion(state.world_from_body)) for state in states],
        class_ids=[CLASS_IDS[state.actor.actor_class] for state in states],
        labels=[f"{state.actor.actor_class} {state.actor.id}" for state in states],
        show_labels=False,
    )


def _quaternion(matrix: Matrix) -> NDArray[np.float64]:
    """x, y, z, w of a pose: yaw, pitch and roll in halves (Diebel, Representing Attitude, 2006)."""
    yaw, pitch, roll = (angle / 2 for angle in poses.angles(matrix))
    cy, sy, cp, sp, cr, sr = (
        *(np.cos(yaw), np.sin(yaw)),
        *(np.cos(pitch), np.sin(pitch)),
        *(np.cos(roll), np.sin(roll)),
    )
    return np.array(
        [
            cy * cp * sr - sy * sp * cr,
            cy * sp * cr + sy * cp * sr,
            sy * cp * cr - cy * sp * sr,
            cy * cp * cr + sy * sp * sr,
        ]
    )


def _road(lanes: Sequence[Lane]) -> rr.LineStrips3D:
    """Both borders of every lane."""
    colours = [LANE_COLOURS.get(lane.kind, OTHER_LANE_COLOUR) for lane in lanes]
    return rr.LineStrips3D(
        [border for lane in lanes for border in (lane.left, lane.right)],
        colors=[colour for colour in colours for _ in range(2)],
        radii=rr.Radius.ui_points(1.0),
    )

"""Recordings of scenarios of other programs, without a spec: only the content of their files."""

from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from advercity.dataset.agent_view import AgentView
from advercity.dataset.boxes import Boxes
from advercity.dataset.foreign_folders import open_foreign_scenarios
from advercity.dataset.image_codec import encode_jpeg
from advercity.dataset.reader import FrameView, Scenario
from advercity.dataset.scenario_folders import no_frames_error
from advercity.errors import InputError
from advercity.geometry import poses
from advercity.viewer.archetypes import (
    CLASS_IDS,
    build_annotation_context,
    build_pinhole,
    choose_agent_colour,
    to_line_strip,
    to_transform3d,
)
from advercity.viewer.blueprint import FRAMES_PER_S, TIMELINE
from advercity.viewer.cloud_colours import colour_intensities
from advercity.viewer.recording import APPLICATION_ID, DRIVEN_PX, open_recording_file
from advercity.viewer.sensor_views import POINT_PX

UNKNOWN_COLOUR = (200, 200, 200)


def write_foreign_recording(path: Path, layout: str, file: Path) -> None:
    """Write a recording of every frame of a scenario: agents, boxes, points and images.

    Args:
        path: Folder of the scenario.
        layout: Layout of its files, as of `open_dataset`.
        file: Recording to write.

    Raises:
        InputError: The folder has no scenario of this layout, or several, or a file is damaged.
    """
    scenario, *others = open_foreign_scenarios(path, layout)
    if others:
        raise InputError(f"{path}: has {len(others) + 1} scenarios; name one, as {scenario.path}")
    if not len(scenario):
        raise no_frames_error(path)
    stream = rr.RecordingStream(APPLICATION_ID, recording_id=scenario.id, send_properties=False)
    stream.set_log_time_enabled(False)  # the same folder gives the same recording
    with open_recording_file(file) as partial:
        stream.set_sinks(rr.FileSink(str(partial)))
        stream.send_recording_name(scenario.id)
        stream.send_blueprint(_build_blueprint(scenario[0]))
        stream.log("world", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
        stream.log("world/actors", build_annotation_context(), static=True)
        _log_scenario(stream, scenario)
        stream.flush()
        stream.disconnect()


def _log_scenario(stream: rr.RecordingStream, scenario: Scenario) -> None:
    driven: dict[str, list[tuple[float, float, float]]] = {name: [] for name in scenario.agents}
    for frame in scenario:
        stream.set_time(TIMELINE, sequence=frame.index)
        stream.set_time("time", duration=frame.time_s)
        for number, (name, view) in enumerate(frame.views.items()):
            stream.log(f"world/actors/{name}", _to_boxes3d(view.boxes))
            _log_sensors(stream, view)
            x, y, z = view.world_from_lidar[:3, 3].tolist()
            driven[name].append((x, y, z))
            strip = to_line_strip(driven[name], choose_agent_colour(number), DRIVEN_PX)
            stream.log(f"world/trajectories/{name}", strip)


def _log_sensors(stream: rr.RecordingStream, view: AgentView) -> None:
    for number in range(view.lidars):
        path, table = f"world/{view.id}/lidar{number}", view.load_cloud(number)
        has_intensity = "intensity" in (table.dtype.names or ())
        colours = colour_intensities(table["intensity"]) if has_intensity else UNKNOWN_COLOUR
        points = np.column_stack([table[axis] for axis in "xyz"])
        stream.log(path, to_transform3d(view.load_lidar_pose(number)))
        stream.log(path, rr.Points3D(points, colors=colours, radii=-POINT_PX))
    for number in range(view.cameras):
        if not view.path(f"_camera{number}.png").is_file():
            continue  # releases without images describe their cameras all the same
        path = _format_camera_path(view, number)
        picture = encode_jpeg(view.image(number))
        stream.log(path, to_transform3d(view.world_from_camera(number)))
        stream.log(path, build_pinhole(view.camera_model(number)))
        stream.log(path, rr.EncodedImage(contents=picture, media_type="image/jpeg"))


def _to_boxes3d(boxes: Boxes) -> rr.Boxes3D:
    """Convert the boxes annotated by an agent, with their classes and ids."""
    # Rerun has the real part of a quaternion last.
    quaternions = [np.roll(poses.to_quaternion(pose), -1) for pose in boxes.world_from_box]
    names = zip(boxes.classes.tolist(), boxes.ids.tolist(), strict=True)
    return rr.Boxes3D(
        centers=boxes.world_from_box[:, :3, 3],
        half_sizes=boxes.sizes / 2,
        quaternions=[rr.Quaternion(xyzw=quaternion) for quaternion in quaternions],
        class_ids=[CLASS_IDS.get(name, 0) for name in boxes.classes.tolist()],
        labels=[f"{name} {number}" for name, number in names],
        show_labels=False,
    )


def _format_camera_path(view: AgentView, number: int) -> str:
    return f"world/{view.id}/camera{number}"


def _build_blueprint(frame: FrameView) -> rrb.Blueprint:
    """Build the window: the scene, and all cameras in a tab for each agent."""
    tabs = [
        rrb.Grid(
            *(
                rrb.Spatial2DView(origin=f"/{_format_camera_path(view, number)}")
                for number in range(view.cameras)
            ),
            name=name,
        )
        for name, view in frame.views.items()
        if view.cameras
    ]
    scene = rrb.Spatial3DView(origin="/world", name="scene")
    time = rrb.TimePanel(timeline=TIMELINE, state="collapsed", fps=FRAMES_PER_S)
    parts = (scene, rrb.Tabs(*tabs)) if tabs else (scene,)
    return rrb.Blueprint(rrb.Horizontal(*parts), time, collapse_panels=True)

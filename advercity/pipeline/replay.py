"""Replays a dataset in Rerun: rebuilds sensor frames from files, spec and trace."""

import subprocess
import sys
import tempfile
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from advercity.conflicts.report import find_conflict_events
from advercity.dataset.agent_view import AgentView, Boxes, extract_measured
from advercity.dataset.image_codec import MAX_DEPTH_CM
from advercity.dataset.reader import Scenario
from advercity.dataset.scenario_folders import no_frames_error
from advercity.errors import InputError, RunError
from advercity.frames import ActorState, Frame
from advercity.geometry.boxes import Box
from advercity.geometry.poses import Matrix, invert_pose
from advercity.pipeline.agent_poses import AgentPoses
from advercity.pipeline.preparation import load_or_simulate_traffic
from advercity.roads.road_network import build_road
from advercity.sensors.measurements import PointCloud
from advercity.sensors.sensor_frame import CameraImage, LidarScan, SensorFrame
from advercity.viewer.cloud_colours import CloudColour
from advercity.viewer.recording import RerunRecording


def load_sensor_frames(
    scenario: Scenario, poses: AgentPoses, index: int
) -> tuple[SensorFrame, ...]:
    """Load the sensor frames of a frame: images and clouds from files, the rest from the trace."""
    stored = scenario.frame(index)
    boxes = [stored[agent.id].boxes for agent in scenario.spec.agents]
    frame = _with_annotated_boxes(poses.load_frame(index), boxes)
    return tuple(
        poses.build_sensor_frame(
            agent,
            frame,
            images=tuple(_load_images(stored[agent.id], poses.world_from_cameras(agent, index))),
            scans=tuple(_load_scans(stored[agent.id], poses.world_from_lidars(agent, frame))),
        )
        for agent in scenario.spec.agents
    )


def _with_annotated_boxes(frame: Frame, annotated: Iterable[Boxes]) -> Frame:
    """Give pedestrians the boxes that any agent annotates; the trace has only their bodies'."""
    found = {
        number: (size, world_from_box)
        for boxes in annotated
        for number, size, world_from_box in zip(
            boxes.ids.tolist(), boxes.sizes, boxes.world_from_box, strict=True
        )
    }

    def fit_state(state: ActorState) -> ActorState:
        if state.actor.actor_class != "pedestrian" or state.actor.id not in found:
            return state
        size, world_from_box = found[state.actor.id]
        body_from_box = invert_pose(state.world_from_body) @ world_from_box
        return replace(state, pose_box=Box(tuple(size), tuple(body_from_box[:3, 3])))

    return replace(frame, states=tuple(map(fit_state, frame.states)))


def _load_images(stored: AgentView, world_from_cameras: Sequence[Matrix]) -> Iterator[CameraImage]:
    """Load images and classes; depths and boxes are not shown, and not in every layout."""
    for camera, world_from_camera in enumerate(world_from_cameras):
        semantic = stored.semantic(camera)
        yield CameraImage(
            world_from_camera=world_from_camera,
            image=stored.image(camera),
            semantic=semantic,
            depth_cm=np.full(semantic.shape, MAX_DEPTH_CM, np.uint16),
            projected_boxes={},
        )


def _load_lidar_hits(stored: AgentView) -> dict[int, int]:
    boxes = stored.boxes
    return dict(zip(boxes.ids.tolist(), boxes.lidar_hits.tolist(), strict=True))


def _load_scans(stored: AgentView, world_from_lidars: Sequence[Matrix]) -> Iterator[LidarScan]:
    """Load point clouds; the first has the hits of all LiDARs, which are stored as sums."""
    for lidar, world_from_lidar in enumerate(world_from_lidars):
        hits = {} if lidar else _load_lidar_hits(stored)
        yield LidarScan(world_from_lidar, _load_point_cloud(stored, lidar), hits)


def _load_point_cloud(stored: AgentView, lidar: int) -> PointCloud:
    """Load the point cloud of a LiDAR; columns that the layout does not have are zero."""
    table = stored.load_cloud(lidar)
    points = np.column_stack([table["x"], table["y"], table["z"]])
    kept = table.dtype.names or ()
    nothing = np.zeros(len(table))
    raw, time_s = extract_measured(table)

    def column(name: str, kind: type[np.generic]) -> NDArray[Any]:
        return (table[name] if name in kept else nothing).astype(kind)

    return PointCloud(
        points=points,
        raw=raw,
        intensity=table["intensity"],
        ring=column("ring", np.uint16),
        time_s=time_s,
        range_m=np.linalg.norm(raw, axis=1),
        semantic=column("tag", np.uint8),
        instance=column("object_id", np.int32),
        kind=column("kind", np.uint8),
    )


def write_recording(path: Path, file: Path, *, cloud_colour: CloudColour = "intensity") -> None:
    """Write a recording of every frame in a scenario's folder."""
    scenario = Scenario(path)
    if not len(scenario):
        raise no_frames_error(path)
    spec = scenario.spec
    traffic = load_or_simulate_traffic(spec)
    if traffic.trace_sha256 != scenario.manifest.identity.trace_sha256:
        raise RunError(
            f"{path}: made from other traffic than this version simulates;"
            " view it with the version that its manifest names"
        )
    poses = AgentPoses(spec, traffic.trace)
    lanes = build_road(spec.road).lanes
    events = find_conflict_events(spec, traffic.trace)
    with RerunRecording(
        spec, lanes, file=file, cloud_colour=cloud_colour, events=events
    ) as recording:
        for stored in scenario:
            recording.log_frame(load_sensor_frames(scenario, poses, stored.index))


def open_viewer(dataset: Path, *, web: bool, cloud_colour: CloudColour = "intensity") -> None:
    """Open a `.rrd` recording, or the folder of a scenario, in Rerun's viewer.

    Args:
        dataset: Recording or folder.
        web: Show it in a browser instead of a window.
        cloud_colour: What the colours of LiDAR points encode; a recording has its own.

    Raises:
        InputError: The path does not exist.
        RunError: The viewer fails.
    """
    if dataset.suffix == ".rrd":
        if not dataset.is_file():
            raise InputError(f"{dataset}: no such recording")
        _show_recording(dataset, web=web)
        return
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "scenario.rrd"
        write_recording(dataset, file, cloud_colour=cloud_colour)
        _show_recording(file, web=web)


def build_viewer_command(
    file: Path, *, web: bool, port: int | None = None, web_port: int | None = None
) -> list[str]:
    """Build the command that opens a recording in Rerun's viewer, for this machine only.

    Args:
        file: Recording (`.rrd`).
        web: Show it in a browser instead of a window.
        port: Port of the recording; None is Rerun's default.
        web_port: Port of the viewer for browsers; None is Rerun's default.
    """
    options = ["--web-viewer"] if web else []
    options += [] if port is None else ["--port", str(port)]
    options += [] if web_port is None else ["--web-viewer-port", str(web_port)]
    return [sys.executable, "-m", "rerun", "--bind", "127.0.0.1", *options, str(file)]


def _show_recording(file: Path, *, web: bool) -> None:
    command = build_viewer_command(file, web=web)
    done = subprocess.run(command, check=False)  # noqa: S603 - rerun's own program on our file
    if done.returncode != 0:
        hint = "" if web else "; without a screen, try `web`"
        raise RunError(f"the viewer ended with exit code {done.returncode}{hint}")

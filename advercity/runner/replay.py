"""Shows what a dataset holds: its readings, put back together, in Rerun."""

import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from advercity.dataset.damage import no_frames
from advercity.dataset.reader import Scenario
from advercity.dataset.reading import Picture, Reading
from advercity.dataset.view import View
from advercity.errors import InputError, RunError
from advercity.poses import Matrix
from advercity.runner.stage import set_stage
from advercity.runner.viewpoints import Viewpoints
from advercity.sensors.lidar import PointCloud
from advercity.viewer.clouds import CloudColour
from advercity.viewer.events import conflict_events
from advercity.viewer.recording import Recording
from advercity.world.roads import built


def stored_readings(scenario: Scenario, viewpoints: Viewpoints, index: int) -> tuple[Reading, ...]:
    """The readings of a frame: what was seen from the files, the rest from spec and trace."""
    frame, stored = viewpoints.frame(index), scenario.frame(index)
    return tuple(
        viewpoints.reading(
            agent,
            frame,
            pictures=tuple(_pictures(stored[agent.id], viewpoints.camera_poses(agent, index))),
            cloud=_cloud(stored[agent.id]),
            visible=_visible(stored[agent.id]),
        )
        for agent in scenario.spec.agents
    )


def _pictures(stored: View, world_from_cameras: Sequence[Matrix]) -> Iterator[Picture]:
    """Depths and sightings are not what a viewer shows, and not every layout has them."""
    for camera, world_from_camera in enumerate(world_from_cameras):
        semantic = stored.semantic(camera)
        yield Picture(
            world_from_camera=world_from_camera,
            image=stored.image(camera),
            semantic=semantic,
            depth=np.full_like(semantic, 255),
            sightings={},
        )


def _visible(stored: View) -> dict[int, int]:
    boxes = stored.boxes
    return dict(zip(boxes.ids.tolist(), boxes.lidar_hits.tolist(), strict=True))


def _cloud(stored: View) -> PointCloud:
    """What a layout does not keep is zero."""
    table = stored.cloud
    points = np.column_stack([table["x"], table["y"], table["z"]])
    kept = table.dtype.names or ()
    nothing = np.zeros(len(table))
    raw, time_s = stored.measured

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


def record(path: Path, file: Path, *, cloud_colour: CloudColour = "intensity") -> None:
    """Make a recording of every frame of a scenario's folder."""
    scenario = Scenario(path)
    if not len(scenario):
        raise no_frames(path)
    spec = scenario.spec
    stage = set_stage(spec)
    if stage.trace_sha256 != scenario.manifest.identity.trace_sha256:
        raise RunError(
            f"{path}: made from other traffic than this version simulates;"
            " look at it with the version that its manifest names"
        )
    viewpoints = Viewpoints(spec, stage.trace)
    lanes = built(spec.road).lanes
    events = conflict_events(spec, stage.trace)
    with Recording(spec, lanes, file=file, cloud_colour=cloud_colour, events=events) as recording:
        for stored in scenario:
            recording.log(stored_readings(scenario, viewpoints, stored.index))


def view(dataset: Path, *, web: bool, cloud_colour: CloudColour = "intensity") -> None:
    """Open a `.rrd` recording, or the folder of a scenario, in Rerun's viewer.

    Args:
        dataset: What to show.
        web: In a browser instead of a window.
        cloud_colour: What the colours of LiDAR points stand for; a recording keeps its own.

    Raises:
        InputError: There is no such thing.
        RunError: The viewer fails.
    """
    if dataset.suffix == ".rrd":
        if not dataset.is_file():
            raise InputError(f"{dataset}: no such recording")
        _show(dataset, web=web)
        return
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "scenario.rrd"
        record(dataset, file, cloud_colour=cloud_colour)
        _show(file, web=web)


def viewer_command(
    file: Path, *, web: bool, port: int | None = None, web_port: int | None = None
) -> list[str]:
    """What opens a recording in Rerun's viewer, for this machine only.

    Args:
        file: `.rrd`.
        web: In a browser instead of a window.
        port: That the recording is served at; Rerun's own if None.
        web_port: That the viewer is served at to a browser; Rerun's own if None.
    """
    options = ["--web-viewer"] if web else []
    options += [] if port is None else ["--port", str(port)]
    options += [] if web_port is None else ["--web-viewer-port", str(web_port)]
    return [sys.executable, "-m", "rerun", "--bind", "127.0.0.1", *options, str(file)]


def _show(file: Path, *, web: bool) -> None:
    command = viewer_command(file, web=web)
    done = subprocess.run(command, check=False)  # noqa: S603 - rerun's own program on our file
    if done.returncode != 0:
        hint = "" if web else "; without a screen, try --web"
        raise RunError(f"the viewer ended with exit code {done.returncode}{hint}")

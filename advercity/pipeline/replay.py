"""Replays a dataset in Rerun: rebuilds sensor frames from files, spec and trace."""

import tempfile
from collections.abc import Callable, Iterable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from advercity_dsl import Spec
from advercity_dsl.sensor_kinds import load_sensor_kinds

from advercity.conflicts.events import find_conflict_events
from advercity.dataset.agent_view import AgentView
from advercity.dataset.boxes import Boxes
from advercity.dataset.reader import Scenario
from advercity.dataset.scenario_folders import no_frames_error
from advercity.documents import suggest_path
from advercity.errors import InputError, RunError
from advercity.frames import ActorState, Frame, Trace
from advercity.geometry.boxes import Box
from advercity.geometry.poses import invert_pose
from advercity.pipeline.preparation import load_or_simulate_traffic
from advercity.roads.road_network import build_road
from advercity.run_options import CloudColour, ViewerTarget
from advercity.sensors.agent_poses import AgentPoses
from advercity.sensors.sensor_frame import SensorFrame

if TYPE_CHECKING:
    from advercity.viewer.recording import RerunRecording


def load_sensor_frames(
    scenario: Scenario, poses: AgentPoses, index: int
) -> tuple[SensorFrame, ...]:
    """Load the sensor frames of a frame: measurements from files, the rest from the trace."""
    stored = scenario.frame(index)
    boxes = [stored[agent.id].boxes for agent in scenario.spec.recorded_agents]
    frame = _with_annotated_boxes(poses.load_frame(index), boxes)
    return tuple(
        poses.build_sensor_frame(
            agent,
            frame,
            readings=_read_all(stored[agent.id]),
            seen_actors=frozenset(of_agent.ids.tolist()),
        )
        for agent, of_agent in zip(scenario.spec.recorded_agents, boxes, strict=True)
    )


def _read_all(stored: AgentView) -> dict[str, tuple[Any, ...]]:
    """Read the measurements of all sensors with a place, by name of the kind."""
    return {
        kind.name: tuple(
            stored.read(kind.name, number) for number in range(stored.count(kind.name))
        )
        for kind in load_sensor_kinds().found.values()
        if kind.has_place
    }


def _with_annotated_boxes(frame: Frame, annotated: Iterable[Boxes]) -> Frame:
    """Give pedestrians their annotated boxes; the trace only has boxes of their bodies."""
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


def write_recording(
    path: Path, file: Path, *, cloud_colour: CloudColour = "intensity", map_tiles: bool = False
) -> None:
    """Write a recording of every frame in a scenario's folder."""
    replay_scenario(path, ViewerTarget(file, cloud_colour=cloud_colour, map_tiles=map_tiles))


def replay_scenario(
    path: Path, target: ViewerTarget, then: Callable[[], None] | None = None
) -> None:
    """Show every frame in a scenario's folder as a run does.

    Args:
        path: Folder of the scenario.
        target: Where the view goes.
        then: Called after the last frame, before the view is closed.
    """
    scenario = Scenario(path)
    if not len(scenario):
        raise no_frames_error(path)
    spec = scenario.spec
    traffic = load_or_simulate_traffic(spec)
    if traffic.trace_sha256 != scenario.manifest.identity.trace_sha256:
        raise RunError(
            f"{path}: made from other traffic than this version simulates;"
            " view it with the version in its manifest"
        )
    poses = AgentPoses(spec, traffic.trace)
    with open_recording(spec, traffic.trace, target) as recording:
        for stored in scenario:
            recording.log_frame(load_sensor_frames(scenario, poses, stored.index))
        if then is not None:
            then()


def open_recording(spec: Spec, trace: Trace, target: ViewerTarget) -> "RerunRecording":
    """Open the recording, server or viewer of a scenario."""
    # Rerun takes a while to load, and most runs are not shown.
    from advercity.viewer.recording import RerunRecording

    return RerunRecording(
        spec,
        build_road(spec.road).lanes,
        file=target.file,
        serve=target.serve,
        connect=target.connect,
        cloud_colour=target.cloud_colour,
        map_tiles=target.map_tiles,
        events=find_conflict_events(spec, trace),
    )


def open_viewer(
    shown: str,
    *,
    web: bool,
    cloud_colour: CloudColour = "intensity",
    map_tiles: bool = False,
    analytics: bool = False,
    layout: str | None = None,
) -> None:
    """Open a recording, a live view or the folder of a scenario in Rerun's viewer.

    Args:
        shown: Recording (`.rrd`), address of a live view, or folder.
        web: Show it in a browser instead of a window.
        cloud_colour: Meaning of the colours of LiDAR points; a recording has its own.
        map_tiles: Show receivers on a map, whose tiles come from the Internet.
        analytics: Let Rerun send usage data, if its own settings do.
        layout: Layout of a foreign folder, as in `open_dataset`.

    Raises:
        InputError: `shown` is no recording, live view or scenario.
        RunError: The viewer fails.
    """
    from advercity.viewer.viewer_process import STREAM_SCHEMES, format_stream_address, show

    if shown.startswith(STREAM_SCHEMES):
        show(shown, web=web, map_tiles=map_tiles, analytics=analytics)
    elif "://" in shown:
        example = format_stream_address()
        raise InputError(f"{shown}: not the address of a live view, such as {example}")
    elif shown.endswith(".rrd"):
        if not Path(shown).is_file():
            hint = suggest_path(Path(shown)) or "`advercity run` with `rrd` writes one"
            raise InputError(f"{shown}: no such recording; {hint}")
        show(shown, web=web, map_tiles=map_tiles, analytics=analytics)
    else:
        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder) / "scenario.rrd"
            if layout is None:
                write_recording(Path(shown), file, cloud_colour=cloud_colour, map_tiles=map_tiles)
            else:
                from advercity.viewer.foreign_recording import write_foreign_recording

                write_foreign_recording(Path(shown), layout, file)
            show(str(file), web=web, map_tiles=map_tiles, analytics=analytics)

"""Shows what a dataset holds: its readings, put back together, in Rerun."""

import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

from advercity.dataset.reading import Reading
from advercity.dataset.stored import Stored, stored_frames, stored_spec
from advercity.errors import InputError, RunError
from advercity.runner.stage import set_stage
from advercity.runner.viewpoints import Viewpoints
from advercity.viewer.recording import Recording
from advercity.world.lanes import lanes
from advercity.world.layout import layout


def stored_readings(scenario: Path, viewpoints: Viewpoints, index: int) -> tuple[Reading, ...]:
    """The readings of a frame: what was seen from the files, the rest from spec and trace."""
    spec, frame = viewpoints.spec, viewpoints.frame(index)
    readings: list[Reading] = []
    for agent in spec.agents:
        stored = Stored(scenario, spec, agent, index)
        readings.append(
            viewpoints.reading(
                agent,
                frame,
                pictures=stored.pictures(viewpoints.camera_poses(agent, index)),
                cloud=stored.cloud(),
                visible=stored.visible(),
            )
        )
    return tuple(readings)


def record(scenario: Path, file: Path) -> None:
    """Make a recording of every frame of a scenario's folder."""
    spec = stored_spec(scenario)
    frames = stored_frames(scenario, spec)
    if not frames:
        raise InputError(f"{scenario}: no frames here")
    viewpoints = Viewpoints(spec, set_stage(spec).trace)
    with Recording(spec, lanes(layout(spec.road)), file=file) as recording:
        for index in frames:
            recording.log(stored_readings(scenario, viewpoints, index))


def view(dataset: Path, *, web: bool) -> None:
    """Open a `.rrd` recording, or the folder of a scenario, in Rerun's viewer.

    Args:
        dataset: What to show.
        web: In a browser instead of a window.

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
        record(dataset, file)
        _show(file, web=web)


def _show(file: Path, *, web: bool) -> None:
    options: Sequence[str] = ("--web-viewer", "--bind", "127.0.0.1") if web else ()
    command = [sys.executable, "-m", "rerun", *options, str(file)]
    done = subprocess.run(command, check=False)  # noqa: S603 - rerun's own program on our file
    if done.returncode != 0:
        hint = "" if web else "; without a screen, try --web"
        raise RunError(f"the viewer ended with exit code {done.returncode}{hint}")

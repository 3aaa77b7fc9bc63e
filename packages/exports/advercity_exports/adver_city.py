"""Summaries of scenarios for the original's `generate_statistics.py`.

    scenarios/<scenario>/summary.yaml

The program takes the folder `scenarios`, which holds nothing else. Its own `generate_summary.py`
writes the same for a dataset in its layout, whose third folder it takes for the ego's.
"""

from typing import Any

from advercity.dataset.adver_city_names import describe_as_original
from advercity.dataset.plain_documents import format_yaml
from advercity.dataset.reader import Dataset, FrameView, Scenario
from advercity.exports.pieces import Piece, PieceFiles, split_by_scenario
from advercity.exports.registry import Options


def list_pieces(dataset: Dataset, options: Options) -> list[Piece]:
    """Make a piece of every scenario."""
    return split_by_scenario(dataset, _write_summary)


def _write_summary(scenario: Scenario, files: PieceFiles) -> None:
    demand, name = scenario.spec.demand, scenario.path.name
    frames = {int(frame.name): _summarise_frame(frame) for frame in files.track(scenario)}
    summary = {
        "simulation": name,
        **describe_as_original(scenario.spec),
        "num_frames": len(frames),
        "num_vehicles": demand.vehicles,
        "num_walkers": demand.walkers,
        "frames": frames,
    }
    files.write(f"scenarios/{name}/summary.yaml", format_yaml(summary).decode())


def _summarise_frame(frame: FrameView) -> dict[Any, Any]:
    """Summarise a frame: speeds in km/h, and by id the objects other than agents."""
    views = sorted(frame.views.values(), key=lambda view: not view.is_ego)
    found = [view.description["vehicles"] | view.description["walkers"] for view in views]
    objects = {number: item for described in reversed(found) for number, item in described.items()}
    ego, agents = found[0], {view.number for view in views}
    vehicles = [view for view in views if not view.is_roadside_unit]
    names = ("ego", *(f"cav{number}" for number in range(1, len(vehicles))))
    speeds = [view.description["ego_speed"] for view in vehicles]
    return {
        "cav_speeds": dict(zip(names, speeds, strict=True)),
        "num_annotations": len(objects),
        **{
            number: {
                "class": item["class"],
                "speed": item["speed"],
                **(
                    {"distance_to_ego": item["dist"], "angle_to_ego": item["relative_angle"]}
                    if number in ego
                    else {}
                ),
            }
            for number, item in objects.items()
            if number not in agents
        },
    }

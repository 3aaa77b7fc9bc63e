"""Figures of the traffic, the LiDARs and the counts of shipped scenarios next to measured ones.

    python benchmarks/realism.py [compiled/ui_clear_day_dense.json ...]

Traffic is of background vehicles only: connected and staged ones follow the declarations. Figures
of LiDARs are the rows about the road in `docs/lidar_measurements.yaml`.
"""

import argparse
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import shapely
from advercity_dsl import Spec
from numpy.typing import NDArray

from advercity.compiler import read_spec
from advercity.conflicts.crossing_people import find_crossing_people, find_roadway
from advercity.conflicts.report import build_traffic_report
from advercity.frames import Trace
from advercity.pipeline.preparation import (
    TrafficResult,
    load_or_build_world,
    load_or_simulate_traffic,
)
from advercity.rendering.raycaster import Raycaster
from advercity.sensors.agent_poses import AgentPoses
from advercity.sensors.annotation import count_lidar_hits
from advercity.sensors.lidar import cast_scan
from advercity.sensors.stage import list_carrier_ids

sys.path.append(str(Path(__file__).parents[1] / "docs"))
from make_lidar_calibration import compare_all  # pyright: ignore[reportMissingImports]

SPECS = sorted(Path("compiled").glob("*_clear_day_*.json"))
"""Weathers share traces, so that one of them represents all."""
ROAD_FIGURES = ("road_level", "road_fill", "wet_road")
"""Kinds of figures of LiDARs that the road decides."""
MOVING_M_S, STANDING_M_S = 0.5, 0.05
FOLLOWING_M_S, FOLLOWING_M = 3.0, 40.0
"""Least speed and greatest gap at which a vehicle counts as one that follows another."""
LANE_M, SAME_WAY_COSINE = 1.2, 0.95
QUEUE_GAP_M = 8.0
STEADY_M_S2 = 0.005
FREE_M_S2 = 0.5
"""Acceleration below which a driver neither brakes for something nor sets out."""
KERB_M = 1.5
"""Greatest distance from the roadway of a person who waits to cross it."""
ANNOTATED_STEP = 20
"""Step of the frames in which annotations are counted."""
PAPER = "Adver-City's paper"
STOP_FROM_M_S, BRAKES_M_S2 = 5.0, 0.3
"""Speed from which a stop counts, and deceleration from which it begins."""


@dataclass(frozen=True)
class Samples:
    """What traces show, each an array (n,)."""

    accelerations_m_s2: NDArray[np.float64]
    headways_s: NDArray[np.float64]
    standing_gaps_m: NDArray[np.float64]
    stops_m_s2: NDArray[np.float64]


def measure_trace(spec: Spec, trace: Trace) -> Samples:
    """Measure the background vehicles of a trace."""
    agents = {agent.number for agent in spec.agents}
    staged = {actor.number for conflict in spec.conflicts for actor in conflict.actors}
    vehicles = np.array([one.actor_class != "pedestrian" for one in trace.actors])
    measured = vehicles & np.array([one.id not in agents | staged for one in trace.actors])
    lengths = np.array([one.size[0] for one in trace.actors])
    rows = trace.states[vehicles[trace.states["actor"]]]
    own = rows[measured[rows["actor"]]]
    found = [find_leaders(rows[rows["tick"] == tick], lengths) for tick in range(len(trace))]
    followers = np.concatenate([one for one, _ in found])
    gaps_m = np.concatenate([gap for _, gap in found])
    kept = measured[followers["actor"]]
    speeds, gaps_m = followers["speed"][kept], gaps_m[kept]
    follows = (speeds > FOLLOWING_M_S) & (gaps_m < FOLLOWING_M)
    waits = (speeds < STANDING_M_S) & (gaps_m < QUEUE_GAP_M)
    stops = [
        stop
        for actor in np.flatnonzero(measured)
        for stop in iterate_stops(own[own["actor"] == actor], trace.tick_s)
    ]
    return Samples(
        own["acceleration"][own["speed"] > MOVING_M_S],
        gaps_m[follows] / speeds[follows],
        # One gap a queue that stands: else those that wait long count often.
        np.unique(np.round(gaps_m[waits], 2)),
        np.array(stops),
    )


def find_leaders(
    rows: NDArray[np.void], lengths: NDArray[np.float64]
) -> tuple[NDArray[np.void], NDArray[np.float64]]:
    """Find the vehicles of a tick that have another ahead in their lane, and the gaps (n,) in m."""
    ahead = np.stack([np.cos(rows["yaw"]), np.sin(rows["yaw"])], axis=1)
    apart = (
        np.stack([rows["x"], rows["y"]], axis=1)[None]
        - np.stack([rows["x"], rows["y"]], axis=1)[:, None]
    )
    along = np.einsum("ijk,ik->ij", apart, ahead)
    across = apart[..., 1] * ahead[:, None, 0] - apart[..., 0] * ahead[:, None, 1]
    half_m = lengths[rows["actor"]] / 2
    leads = (along > 0) & (np.abs(across) < LANE_M) & (ahead @ ahead.T > SAME_WAY_COSINE)
    gaps = np.where(leads, along - half_m[:, None] - half_m, np.inf).min(axis=1, initial=np.inf)
    return rows[np.isfinite(gaps)], gaps[np.isfinite(gaps)]


def iterate_stops(track: NDArray[np.void], tick_s: float) -> Iterator[float]:
    """Iterate over the mean decelerations of the stops of a vehicle, from braking on to rest."""
    stands = track["speed"] < STANDING_M_S
    for end in np.flatnonzero(stands[1:] & ~stands[:-1]) + 1:
        eases = np.flatnonzero(track["acceleration"][:end] > -BRAKES_M_S2)
        eases = eases[track["speed"][eases] > MOVING_M_S]
        begin = int(eases[-1]) if len(eases) else 0
        if track["speed"][begin] > STOP_FROM_M_S:
            yield float(track["speed"][begin] / ((end - begin) * tick_s))


def format_traffic(specs: Sequence[Spec], traces: Sequence[Trace]) -> str:
    """Format the figures of traffic as a table in Markdown."""
    samples = [measure_trace(*pair) for pair in zip(specs, traces, strict=True)]
    acceleration, headway, gap, stop = (
        np.concatenate([getattr(one, name) for one in samples])
        for name in ("accelerations_m_s2", "headways_s", "standing_gaps_m", "stops_m_s2")
    )
    free = acceleration[np.abs(acceleration) < FREE_M_S2]
    rows = (
        ("moving, with an acceleration of 0", f"{np.mean(acceleration == 0):.1%}", "0 %", "-"),
        (
            "moving, with less than 0.005 m/s2",
            f"{np.mean(np.abs(acceleration) < STEADY_M_S2):.1%}",
            "few",
            "-",
        ),
        (
            "acceleration noise of free driving, m/s2",
            f"{free.std():.2f}",
            "0.1 to 0.3",
            "Jones and Potts, Operations Research 10, 1962: 0.01 to 0.03 g",
        ),
        (
            "hardest braking, m/s2",
            f"{-acceleration.min():.1f}",
            "up to 7.5",
            "El-Shawarby and others, Transportation Research Record 2018, 2007",
        ),
        (
            "mean deceleration of a stop, m/s2",
            f"{stop.mean():.1f} ({stop.min():.1f} to {stop.max():.1f}, n = {len(stop)})",
            "3.3 (1.5 to 7.5) from 72 km/h; 2.2 with most time",
            "the same, 821 stops",
        ),
        (
            "time gap of followers, s: median, 15th and 85th percentile",
            " ".join(f"{value:.1f}" for value in np.percentile(headway, [50, 15, 85])),
            "lognormal, coefficient of variation up to 0.64",
            "Loulizi and others, Journal of Advanced Transportation 2019",
        ),
        ("coefficient of variation of that", f"{headway.std() / headway.mean():.2f}", "", ""),
        (
            "gap in a queue, m: mean and standard deviation",
            f"{gap.mean():.1f} {gap.std():.1f}",
            "1.5 in Britain, 3.7 in the United States",
            "Bell, 1977; Long, Transportation Research Record 1796, 2002",
        ),
    )
    people = [
        describe_crossing_people(spec, trace)
        for spec, trace in zip(specs, traces, strict=True)
        if spec.demand.crossing_share
    ]
    return format_table([*rows, *people])


def describe_crossing_people(spec: Spec, trace: Trace) -> tuple[str, str, str, str]:
    """Describe how many people set foot on a roadway, and where the others of them are."""
    staged = {actor.number for conflict in spec.conflicts for actor in conflict.actors}
    people = {one.id for one in trace.actors if one.actor_class == "pedestrian"} - staged
    roadway = find_roadway(spec)
    crossed = people & find_crossing_people(trace, roadway)
    last = trace.states[trace.states["tick"] == len(trace) - 1]
    ids = np.array([one.id for one in trace.actors])[last["actor"]]
    is_waiting = (last["speed"] < STANDING_M_S) & (
        shapely.distance(roadway, shapely.points(last["x"], last["y"])) < KERB_M
    )
    waiting = (people - crossed) & set(ids[is_waiting].tolist())
    declared = round(spec.demand.crossing_share * len(people))
    kept = max(declared - len(crossed) - len(waiting), 0)
    reasons = (
        (len(waiting), "still at a kerb"),
        (kept, "kept off all crossings, where they would block others"),
    )
    return (
        f"people who set foot on a roadway, {spec.id}",
        ", ".join([f"{len(crossed)} of {len(people)}", *(f"{n} {why}" for n, why in reasons if n)]),
        str(declared),
        f"declared share of {spec.demand.crossing_share:g}: Adver-City's crossing factor",
    )


def format_counts(specs: Sequence[Spec], traffic: Sequence[TrafficResult]) -> str:
    """Format the counts of frames, road users and annotations next to the paper's."""
    reports = [
        build_traffic_report(spec, one.trace, "") for spec, one in zip(specs, traffic, strict=True)
    ]
    annotated = [count_annotations(*pair) for pair in zip(specs, traffic, strict=True)]
    means = (
        ("frames of a scenario", [one.frames for one in reports], "219"),
        ("vehicles of a scenario", [one.vehicles for one in reports], "52"),
        ("people of a scenario", [one.pedestrians for one in reports], "44"),
        ("annotated road users a frame", annotated, "37: 890,000 in 24,000 frames"),
    )
    rows = [
        (name, f"{np.mean(found):.0f} ({min(found):.0f} to {max(found):.0f})", paper, PAPER)
        for name, found, paper in means
    ]
    return format_table(rows)


def count_annotations(spec: Spec, traffic: TrafficResult) -> float:
    """Count the road users a frame that a beam of any agent's first LiDAR meets, in the mean.

    Each counts once, and parked cars do not, as in the original's summaries.
    """
    poses = AgentPoses(spec, traffic.trace)
    raycaster = Raycaster(load_or_build_world(spec, traffic.network_path))
    counts: list[int] = []
    for index in range(0, len(traffic.trace), ANNOTATED_STEP):
        frame = poses.load_frame(index)
        moving = {state.actor.id for state in frame.states if not state.is_parked}
        met: set[int] = set()
        for agent in spec.agents:
            raycaster.place(frame, hide=list_carrier_ids(agent))
            pose = poses.world_from_sensors("lidar", agent, frame)[0]
            lidar = agent.sensors.lidars[0]
            met.update(count_lidar_hits(cast_scan(lidar, pose, raycaster), lidar))
        counts.append(len(met & moving))
    return float(np.mean(counts))


def format_lidars() -> str:
    """Format what LiDARs make of the road next to real scans."""
    rows = [
        (
            item.measurement.name,
            f"{item.model:.3g}",
            f"{item.measurement.published:g}" + (" (fitted)" if item.measurement.sets else ""),
            item.measurement.source,
        )
        for item in compare_all()
        if item.measurement.figure["kind"] in ROAD_FIGURES
    ]
    return format_table(rows)


def format_table(rows: Sequence[tuple[str, ...]]) -> str:
    """Format rows of figure, value, reference and source as a table in Markdown."""
    heads = ("figure", "here", "reference", "source")
    lines = [heads, ("---",) * len(heads), *rows]
    return "".join("| " + " | ".join(line) + " |\n" for line in lines)


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("specs", nargs="*", type=Path, default=SPECS)
    specs = [read_spec(path) for path in parser.parse_args().specs]
    traffic = [load_or_simulate_traffic(spec) for spec in specs]
    tables = (
        format_traffic(specs, [one.trace for one in traffic]),
        format_lidars(),
        format_counts(specs, traffic),
    )
    print(*tables, sep="\n", end="")


if __name__ == "__main__":
    main()

"""One radar in one frame: paths, other radars, spray and receiver together."""

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from advercity.geometry.arrays import Float64Array, FloatArray, IndexArray
from advercity.rendering.raycaster import Raycaster
from advercity.sensors.radar.cells import CellGrid
from advercity.sensors.radar.clutter import list_spray_paths
from advercity.sensors.radar.conditions import RadarConditions
from advercity.sensors.radar.detections import RadarMeasurement, Receiver
from advercity.sensors.radar.interference import compute_interference
from advercity.sensors.radar.motion import SceneMotion
from advercity.sensors.radar.paths import Paths, trace_paths
from advercity.sensors.radar.placement import PlacedRadar


def scan_radar(
    placed: PlacedRadar,
    others: Iterable[PlacedRadar],
    raycaster: Raycaster,
    motion: SceneMotion,
    conditions: RadarConditions,
    rng: np.random.Generator,
) -> RadarMeasurement:
    """Measure with one radar in a frame.

    Args:
        placed: The radar.
        others: All other radars of the scene, which disturb it.
        raycaster: Placed at the frame, with the radar's carrier hidden.
        motion: Motion of the actors of the frame.
        conditions: Air, road and radome.
        rng: Generator of this radar and frame.
    """
    grid = CellGrid.from_radar(placed.radar)
    found = trace_paths(placed, raycaster, motion, wetness=conditions.wetness)
    free_m = compute_free_ranges(grid, found.directions, found.free_m)
    parts = [found.paths]
    if conditions.has_spray:
        plumes = list_spray_paths(placed, motion.frame.states)
        parts += [_hide_behind(grid, paths, free_m) for paths in plumes]
    noise = compute_interference(placed, others, raycaster)
    receiver = Receiver(placed, conditions, noise, rng, raycaster.cover)
    measured = receiver.measure(Paths.join(parts), free_m)
    # Mirrored echoes depend on the wetness of roads, direct ones on no weather.
    direct = found.paths.instance[found.paths.mirrorings == 0]
    return replace(measured, seen_actors=frozenset(np.unique(direct[direct > 0]).tolist()))


def compute_free_ranges(grid: CellGrid, directions: FloatArray, free_m: FloatArray) -> Float64Array:
    """Compute the free ranges of beams.

    Args:
        grid: Cells of the radar.
        directions: (n, 3) of rays, radar frame.
        free_m: (n,) free ranges of the rays.

    Returns:
        (azimuths, elevations) ranges of the farthest free ray.
    """
    _, azimuths, elevations, _ = grid.counts
    beam = _find_beams(grid, directions)
    farthest = np.zeros(azimuths * elevations)
    np.maximum.at(farthest, beam, free_m)
    return farthest.reshape(azimuths, elevations)


def _hide_behind(grid: CellGrid, paths: Paths, free_m: Float64Array) -> Paths:
    """Leave out the paths hidden by surfaces."""
    beam = _find_beams(grid, paths.direction)
    return paths.select(np.flatnonzero(paths.range_m < free_m.ravel()[beam]))


def _find_beams(grid: CellGrid, direction: FloatArray) -> IndexArray:
    none = np.zeros(len(direction))
    _, azimuth, elevation, _ = grid.locate(none, none, direction)
    return azimuth * grid.counts[2] + elevation

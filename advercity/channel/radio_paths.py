"""Obstacles between two antennas, by rays against the buildings, the ground and the vehicles."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from advercity.channel.propagation import PathState, RadioPath
from advercity.frames import ActorState, Frame
from advercity.geometry.arrays import Float64Array
from advercity.rendering.raycaster import Raycaster, RayHits, Rays
from advercity.semantics import OPAQUE_TO_RADIO
from advercity.world import World

BLOCKING_CLASSES = ("car", "van", "truck")
"""Actors that block a path as vehicles do in TR 37.885."""


@dataclass(frozen=True, eq=False)
class Antenna:
    """The antenna of a station.

    Attributes:
        position: (3,) in the world.
        carrier: Id of its vehicle; 0 for a roadside unit.
    """

    position: Float64Array
    carrier: int


class RadioPaths:
    """Finds the paths between antennas in a world, frame by frame."""

    def __init__(self, world: World) -> None:
        static = tuple(mesh for mesh in world.static if mesh.semantic in OPAQUE_TO_RADIO)
        self._raycaster = Raycaster(replace(world, static=static))

    def find(self, frame: Frame, pairs: Sequence[tuple[Antenna, Antenna]]) -> tuple[RadioPath, ...]:
        """Find the path of every pair of antennas."""
        self._raycaster.place(frame, hide=frozenset(state.actor.id for state in frame.states))
        hits = self._cast(pairs)
        states = {state.actor.id: state for state in frame.states}
        return tuple(
            _build_path(pair, PathState.NLOS)
            if np.isfinite(range_m)
            else self._find_vehicles(frame, states, pair)
            for pair, range_m in zip(pairs, hits.range_m.tolist(), strict=True)
        )

    def _find_vehicles(
        self, frame: Frame, states: Mapping[int, ActorState], pair: tuple[Antenna, Antenna]
    ) -> RadioPath:
        """Find the tallest vehicle on a path, by hiding found vehicles until none is left."""
        hidden = {pair[0].carrier, pair[1].carrier}
        hidden |= {
            number
            for number, state in states.items()
            if state.actor.actor_class not in BLOCKING_CLASSES
        }
        blockers: list[int] = []
        while True:
            self._raycaster.place(frame, hide=frozenset(hidden))
            (found,) = self._cast([pair]).instance.tolist()
            if not found:
                break
            blockers.append(found)
            hidden.add(found)
        if not blockers:
            return _build_path(pair, PathState.LOS)
        tallest = max(blockers, key=lambda number: (states[number].actor.size[2], -number))
        return _build_path(pair, PathState.NLOSV, states[tallest])

    def _cast(self, pairs: Sequence[tuple[Antenna, Antenna]]) -> RayHits:
        """Cast a ray from the first to the second antenna of each pair."""
        first, second = (np.array([pair[end].position for pair in pairs]) for end in (0, 1))
        lengths = np.linalg.norm(second - first, axis=1)
        directions = (second - first) / np.maximum(lengths, 1e-9)[:, None]
        rays = Rays(first.astype(np.float32), directions.astype(np.float32))
        hits = self._raycaster.cast(rays, float(lengths.max()))
        # Hits behind the second antenna are not on the path.
        beyond = hits.range_m >= lengths
        hits.range_m[beyond], hits.instance[beyond] = np.inf, 0
        return hits


def _build_path(
    pair: tuple[Antenna, Antenna], state: PathState, blocker: ActorState | None = None
) -> RadioPath:
    """Build a path; its heights are over the ground under the blocker, if there is one."""
    first, second = (antenna.position for antenna in pair)
    ground_m = 0.0 if blocker is None else float(blocker.world_from_body[2, 3])
    return RadioPath(
        state=state,
        distance_m=float(np.linalg.norm(second - first)),
        antenna_heights_m=(float(first[2]) - ground_m, float(second[2]) - ground_m),
        blocker=0 if blocker is None else blocker.actor.id,
        blocker_height_m=0.0 if blocker is None else blocker.actor.size[2],
    )

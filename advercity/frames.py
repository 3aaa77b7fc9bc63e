"""What traffic did: every actor and signal at every kept tick, and how it is stored.

What a connected vehicle is about to drive.
"""

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, fields
from enum import IntEnum, IntFlag
from pathlib import Path

import numpy as np
from advercity_dsl import ActorClass
from numpy.typing import NDArray

from advercity.errors import RunError
from advercity.geometry.poses import Matrix, pose_matrix


class Lamp(IntFlag):
    """Lamps of a vehicle that are lit."""

    LOW_BEAM = 1
    BRAKE = 2
    FOG = 4
    LEFT = 8
    RIGHT = 16


class Signal(IntEnum):
    """What a traffic light shows."""

    RED = 0
    YELLOW = 1
    GREEN = 2


@dataclass(frozen=True)
class Actor:
    """Somebody or something that moves; the same for the whole scenario."""

    id: int
    """Positive; connected vehicles have their agent's number."""
    actor_class: ActorClass
    blueprint: str
    paint: str
    """Material of its painted parts, or of a person's coat."""
    size: tuple[float, float, float]
    """Full length, width and height in metres."""


@dataclass(frozen=True)
class ActorState:
    """An actor at one tick."""

    actor: Actor
    world_from_body: Matrix
    """(4, 4); origin on the ground under the middle of the box, x forward."""
    speed_m_s: float
    acceleration_m_s2: float
    lamps: Lamp
    yaw_rate_rad_s: float = 0.0
    """Counter-clockwise."""
    steering_rad: float = 0.0
    """Of the front wheels against the body, to the left; 0 for people."""
    travelled_m: float = 0.0
    """Way since the actor appeared: what turns its wheels and swings its legs."""
    umbrella: bool = False
    """Whether it would hold one up; the weather tells, not the trace."""


@dataclass(frozen=True)
class Frame:
    """One tick, ready to render and to sense."""

    index: int
    """Counts from the first kept tick."""
    time_s: float
    """Since the scenario's start, warm-up included."""
    states: tuple[ActorState, ...]
    signals: Mapping[str, Signal]
    """By `SignalLamp.id`."""

    def get_state(self, actor_id: int) -> ActorState:
        """State of one actor; KeyError if it is not there in this frame."""
        for state in self.states:
            if state.actor.id == actor_id:
                return state
        raise KeyError(actor_id)


STATE_DTYPE = np.dtype(
    [
        ("tick", "<i4"),
        ("actor", "<i4"),
        ("x", "<f8"),
        ("y", "<f8"),
        ("z", "<f8"),
        ("yaw", "<f8"),
        ("pitch", "<f8"),
        ("speed", "<f8"),
        ("acceleration", "<f8"),
        ("yaw_rate", "<f8"),
        ("steering", "<f8"),
        ("travelled", "<f8"),
        ("lamps", "<u1"),
    ]
)
"""A row of the trace: kept tick, index into `actors`, world position (m), yaw and pitch (rad), m/s,
m/s², rad/s, rad, m."""

STATE_COLUMNS = tuple(STATE_DTYPE.names or ())


@dataclass(frozen=True)
class Trace:
    """Traffic of a scenario.

    Attributes:
        tick_s: Length of a tick.
        first_tick: Ticks of warm-up before the first kept one.
        actors: Everybody who appears.
        states: (n,) of `STATE`, sorted by tick, then actor.
        signal_ids: Ids of `SignalLamp`.
        signals: (ticks, signals) uint8 of `Signal`.
    """

    tick_s: float
    first_tick: int
    actors: tuple[Actor, ...]
    states: NDArray[np.void]
    signal_ids: tuple[str, ...]
    signals: NDArray[np.uint8]

    def __len__(self) -> int:
        """Kept ticks."""
        return len(self.signals)

    def build_frame(self, index: int) -> Frame:
        """Kept tick `index`, from 0."""
        if not 0 <= index < len(self):
            raise IndexError(f"frame {index} of {len(self)}")
        first, last = np.searchsorted(self.states["tick"], [index, index + 1])
        return Frame(
            index=index,
            time_s=(self.first_tick + index) * self.tick_s,
            states=tuple(self._build_state(row) for row in self.states[first:last]),
            signals={
                name: Signal(int(value))
                for name, value in zip(self.signal_ids, self.signals[index], strict=True)
            },
        )

    def _build_state(self, row: NDArray[np.void]) -> ActorState:
        return ActorState(
            actor=self.actors[int(row["actor"])],
            world_from_body=pose_matrix(
                (row["x"], row["y"], row["z"]), yaw=float(row["yaw"]), pitch=float(row["pitch"])
            ),
            speed_m_s=float(row["speed"]),
            acceleration_m_s2=float(row["acceleration"]),
            lamps=Lamp(int(row["lamps"])),
            yaw_rate_rad_s=float(row["yaw_rate"]),
            steering_rad=float(row["steering"]),
            travelled_m=float(row["travelled"]),
        )

    def compute_sha256(self) -> str:
        """Of all that it holds; files may differ, since libraries compress each in its way."""
        digest = hashlib.sha256()
        for name, column in self._columns().items():
            digest.update(f"{name} {column.dtype.str} {column.shape}\n".encode())
            digest.update(column.tobytes())
        return digest.hexdigest()

    def save(self, path: Path) -> None:
        """Write as `.npz`, an array per column."""
        with path.open("wb") as stream:
            np.savez_compressed(stream, allow_pickle=False, **self._columns())

    def _columns(self) -> dict[str, NDArray[np.generic]]:
        table = {
            f"actor_{item.name}": np.array([getattr(actor, item.name) for actor in self.actors])
            for item in fields(Actor)
        }
        return {
            "tick_s": np.array(self.tick_s),
            "first_tick": np.array(self.first_tick),
            **{f"state_{name}": self.states[name] for name in STATE_COLUMNS},
            "signal_ids": np.array(self.signal_ids, dtype=np.str_),
            "signals": self.signals,
            **table,
        }

    @staticmethod
    def load(path: Path) -> "Trace":
        """Read what `save` wrote; RunError if it is something else."""
        try:
            with np.load(path, allow_pickle=False) as data:
                columns = [data[f"actor_{item.name}"].tolist() for item in fields(Actor)]
                actors = tuple(
                    Actor(*values[:-1], size=tuple(values[-1]))
                    for values in zip(*columns, strict=True)
                )
                return Trace(
                    tick_s=float(data["tick_s"]),
                    first_tick=int(data["first_tick"]),
                    actors=actors,
                    states=_rows_from_columns(
                        {name: data[f"state_{name}"] for name in STATE_COLUMNS}
                    ),
                    signal_ids=tuple(data["signal_ids"].tolist()),
                    signals=data["signals"],
                )
        except (OSError, ValueError, KeyError) as error:
            raise RunError(f"{path}: not a trace: {error}") from error


def _rows_from_columns(columns: Mapping[str, NDArray[np.generic]]) -> NDArray[np.void]:
    rows = np.empty(len(columns["tick"]), STATE_DTYPE)
    for name, column in columns.items():
        rows[name] = column
    return rows


def extract_planned_trajectory(
    trace: Trace, actor_id: int, index: int, *, point_count: int = 9, step_s: float = 0.2
) -> NDArray[np.float64]:
    """The plan of an actor at a kept tick: what the trace says it will do.

    Beyond its last tick the actor is taken to go straight on at its last speed.

    Returns:
        (points, 3): world x and y in metres and speed in m/s, `step_s` apart, the first one
        `step_s` ahead.

    Raises:
        KeyError: The actor is not there at that tick.
    """
    number = next((at for at, actor in enumerate(trace.actors) if actor.id == actor_id), None)
    track = trace.states[(trace.states["actor"] == number) & (trace.states["tick"] >= index)]
    if len(track) == 0 or track["tick"][0] != index:
        raise KeyError(actor_id)
    ahead_s = step_s * np.arange(1, point_count + 1)
    times_s = (track["tick"] - index) * trace.tick_s
    beyond_m = np.maximum(ahead_s - times_s[-1], 0) * track["speed"][-1]
    return np.column_stack(
        [
            np.interp(ahead_s, times_s, track["x"]) + beyond_m * np.cos(track["yaw"][-1]),
            np.interp(ahead_s, times_s, track["y"]) + beyond_m * np.sin(track["yaw"][-1]),
            np.interp(ahead_s, times_s, track["speed"]),
        ]
    )


FRONT_DTYPE = np.dtype(
    [
        ("tick", "<i4"),
        ("id", "<i4"),
        ("x", "<f8"),
        ("y", "<f8"),
        ("z", "<f8"),
        ("yaw", "<f8"),
        ("slope", "<f8"),
        ("speed", "<f8"),
        ("acceleration", "<f8"),
        ("lamps", "<u1"),
    ]
)
"""An actor at one tick: middle of its front, heading and slope of its lane (rad), m/s, m/s²."""

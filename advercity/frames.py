"""Traffic, tick by tick: `Trace` holds all of it in arrays, `Frame` one tick as objects.

All later rooms take these types. A pose is a row of `STATE_DTYPE`, and a matrix in a frame.
"""

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from enum import IntEnum, IntFlag
from pathlib import Path
from typing import Any, get_args

import numpy as np
from advercity_dsl import ActorClass, Blueprint
from numpy.typing import NDArray

from advercity.array_files import load_arrays
from advercity.errors import RunError
from advercity.geometry.boxes import Box
from advercity.geometry.poses import (
    Matrix,
    from_rotation_vector,
    pose_matrix,
    transform_points,
)


class Lamp(IntFlag):
    """Lamps of a vehicle, as bits of the lit ones."""

    LOW_BEAM = 1
    BRAKE = 2
    FOG = 4
    LEFT = 8
    RIGHT = 16
    HIGH_BEAM = 32


class Signal(IntEnum):
    """Shown light of a traffic light."""

    RED = 0
    YELLOW = 1
    GREEN = 2


WHEELBASE_FRACTION = 0.6
"""Distance of the axles as a fraction of a vehicle's length; the body's centre is between them."""


@dataclass(frozen=True)
class Actor:
    """A road user or a parked vehicle; the same for the whole scenario."""

    id: int
    """Positive; a connected vehicle has its agent's number."""
    actor_class: ActorClass
    blueprint: str
    paint: str
    """Material of a vehicle's painted parts, or of a person's coat."""
    size: tuple[float, float, float]
    """Full length, width and height in metres; of a pedestrian, in all poses of the gait."""
    towed_by: int = 0
    """Id of the tractor unit of a semi-trailer, whose lamps it has; 0 of all others."""

    @staticmethod
    def from_blueprint(
        number: int, name: str, blueprint: Blueprint, paint: str, *, towed_by: int = 0
    ) -> "Actor":
        """Build an actor from the blueprint of a name."""
        return Actor(number, blueprint.actor_class, name, paint, blueprint.size, towed_by)

    @property
    def vehicle_id(self) -> int:
        """Id of its whole vehicle: for a semi-trailer, the tractor unit's."""
        return self.towed_by or self.id


@dataclass(frozen=True, eq=False)
class BodyMotion:
    """First and second derivatives of a body's pose.

    Attributes:
        velocity: (3,) of the body's origin in the world, m/s.
        acceleration: (3,) of the body's origin in the world, m/s².
        angular_rate: (3,) in the body frame, rad/s.
    """

    velocity: NDArray[np.float64]
    acceleration: NDArray[np.float64]
    angular_rate: NDArray[np.float64]

    def advance_pose(self, pose: Matrix, time_s: float) -> Matrix:
        """Advance the body's pose (4, 4) by a short time, which may be negative.

        By its first and second derivatives: the error grows with the third power of the time, 1 mm
        in 0.1 s at a jerk of 6 m/s³.
        """
        moved = pose.copy()
        moved[:3, 3] += time_s * self.velocity + 0.5 * time_s**2 * self.acceleration
        moved[:3, :3] = pose[:3, :3] @ from_rotation_vector(time_s * self.angular_rate)
        return moved


AT_REST = BodyMotion(np.zeros(3), np.zeros(3), np.zeros(3))


@dataclass(frozen=True)
class ActorState:
    """An actor at one tick."""

    actor: Actor
    world_from_body: Matrix
    """(4, 4); origin on the ground under the centre of the body, x forward, y left, z up."""
    speed_m_s: float
    """Magnitude of the velocity."""
    acceleration_m_s2: float
    """Part of the acceleration along the body's x axis, as an IMU measures it without gravity."""
    lamps: Lamp
    steering_rad: float = 0.0
    """Angle of the front wheels to the body, positive to the left; 0 for people."""
    travelled_m: float = 0.0
    """Distance since the actor appeared, which turns its wheels and swings its legs."""
    umbrella: bool = False
    """Whether a person holds one up; set from the weather, not part of the trace."""
    figure: int = 0
    """Number of a person within its blueprint; not part of the trace."""
    is_parked: bool = False
    """Whether it belongs to the scene, not to the traffic; not part of the trace."""
    pose_box: Box | None = None
    """Box of a pedestrian in its pose, without umbrella; set from the body, not part of the
    trace."""
    motion: BodyMotion = AT_REST
    has_led_headlamps: bool = False
    """Whether its headlamps have LEDs instead of halogen bulbs; not part of the trace."""
    tail_light_ratio: float = 1.0
    """Light of its tail lamps in an exposure, relative to their mean; not part of the trace."""

    @property
    def box(self) -> Box:
        """The box for annotations, in the body frame."""
        return self.pose_box or self.steady_box

    @property
    def steady_box(self) -> Box:
        """The box around all poses of a gait, moving with the body, in the body frame."""
        return Box.on_ground(self.actor.size)

    @property
    def box_centre(self) -> NDArray[np.float64]:
        """Middle (3,) of the box in the world."""
        return transform_points(self.world_from_body, self.box.centre)

    def advance(self, time_s: float) -> "ActorState":
        """Advance the actor by a short time, which may be negative; its lamps stay."""
        velocity = self.motion.velocity + time_s * self.motion.acceleration
        return replace(
            self,
            world_from_body=self.motion.advance_pose(self.world_from_body, time_s),
            motion=replace(self.motion, velocity=velocity),
            travelled_m=self.travelled_m + time_s * self.speed_m_s,
        )


@dataclass(frozen=True)
class Frame:
    """One tick, ready to render and to sense."""

    index: int
    """Number of the tick, from 0 at the first kept one."""
    time_s: float
    """Time since the scenario's start, warm-up included."""
    states: tuple[ActorState, ...]
    signals: Mapping[str, Signal]
    """State of traffic lights by `SignalLamp.id`."""
    signal_light_ratios: Mapping[str, float] = field(default_factory=dict[str, float])
    """Light of traffic lights in a camera's exposure, relative to its mean; 1 for all others."""

    def get_state(self, actor_id: int) -> ActorState:
        """Return the state of an actor; KeyError if it is not in this frame."""
        for state in self.states:
            if state.actor.id == actor_id:
                return state
        raise KeyError(actor_id)

    def advance(self, time_s: float) -> "Frame":
        """Advance all actors by a part of a tick, which may be negative; signals stay."""
        states = tuple(state.advance(time_s) for state in self.states)
        return replace(self, time_s=self.time_s + time_s, states=states)


STATE_DTYPE = np.dtype(
    [
        ("tick", "<i4"),
        ("actor", "<i4"),
        ("x", "<f8"),
        ("y", "<f8"),
        ("z", "<f8"),
        ("yaw", "<f8"),
        ("pitch", "<f8"),
        ("roll", "<f8"),
        ("vx", "<f8"),
        ("vy", "<f8"),
        ("vz", "<f8"),
        ("ax", "<f8"),
        ("ay", "<f8"),
        ("az", "<f8"),
        ("yaw_rate", "<f8"),
        ("pitch_rate", "<f8"),
        ("roll_rate", "<f8"),
        ("speed", "<f8"),
        ("acceleration", "<f8"),
        ("steering", "<f8"),
        ("travelled", "<f8"),
        ("lamps", "<u1"),
    ]
)
"""A row of a trace: kept tick, index into `Trace.actors`, world position in m, yaw, pitch and roll
in rad, velocity in m/s, acceleration in m/s², rates of yaw, pitch and roll in rad/s, speed in m/s,
acceleration along the body in m/s², steering in rad, distance travelled in m, and `Lamp` bits.
Velocity, acceleration and rates are derivatives of position and angles; speed is the magnitude of
velocity. The columns of the file have the same names and order."""

STATE_COLUMNS = tuple(STATE_DTYPE.names or ())
ROLL_COLUMNS = ("roll", "roll_rate")
"""Columns missing in a file if all bodies are upright."""


@dataclass(frozen=True)
class Trace:
    """The traffic of a scenario.

    Attributes:
        tick_s: Length of a tick.
        first_tick: Ticks of warm-up before the first kept one.
        actors: All actors in the trace.
        states: (n,) of `STATE_DTYPE`, sorted by tick, then actor.
        signal_ids: Ids of `SignalLamp`.
        signals: (ticks, signals) uint8 of `Signal`.
    """

    tick_s: float
    first_tick: int
    actors: tuple[Actor, ...]
    states: NDArray[np.void]
    signal_ids: tuple[str, ...]
    signals: NDArray[np.uint8]

    def cut(self, ticks: int) -> "Trace":
        """Return the first ticks of the trace, with the actors in them."""
        states = self.states[self.states["tick"] < ticks]
        present, states["actor"] = np.unique(states["actor"], return_inverse=True)
        actors = tuple(self.actors[index] for index in present)
        return replace(self, actors=actors, states=states, signals=self.signals[:ticks])

    def __len__(self) -> int:
        """Return the number of kept ticks."""
        return len(self.signals)

    def build_frame(self, index: int) -> Frame:
        """Build the frame of kept tick `index`, from 0; IndexError if there is none."""
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

    def get_track(self, actor_id: int) -> tuple[Actor, NDArray[np.void]]:
        """Return an actor and its rows, sorted by tick; KeyError if the trace has none."""
        for index, actor in enumerate(self.actors):
            if actor.id == actor_id:
                return actor, self.states[self.states["actor"] == index]
        raise KeyError(actor_id)

    def _build_state(self, row: NDArray[np.void]) -> ActorState:
        return ActorState(
            actor=self.actors[int(row["actor"])],
            world_from_body=pose_matrix(
                (row["x"], row["y"], row["z"]),
                yaw=float(row["yaw"]),
                pitch=float(row["pitch"]),
                roll=float(row["roll"]),
            ),
            speed_m_s=float(row["speed"]),
            acceleration_m_s2=float(row["acceleration"]),
            lamps=Lamp(int(row["lamps"])),
            steering_rad=float(row["steering"]),
            travelled_m=float(row["travelled"]),
            motion=_build_motion(row),
        )

    def compute_sha256(self) -> str:
        """Hash the content, not the file, whose compression depends on the version of zlib."""
        digest = hashlib.sha256()
        for name, column in self._columns().items():
            digest.update(f"{name} {column.dtype.str} {column.shape}\n".encode())
            digest.update(column.tobytes())
        return digest.hexdigest()

    def save(self, path: Path) -> None:
        """Write an `.npz` file with an array per column."""
        with path.open("wb") as stream:
            np.savez_compressed(stream, allow_pickle=False, **self._columns())

    def _columns(self) -> dict[str, NDArray[np.generic]]:
        # Without trailers and roll there are no columns for them: old checksums stay.
        names = [item.name for item in fields(Actor)]
        if not any(actor.towed_by for actor in self.actors):
            names.remove("towed_by")
        leans = any(self.states[name].any() for name in ROLL_COLUMNS)
        columns = [name for name in STATE_COLUMNS if leans or name not in ROLL_COLUMNS]
        table = {
            f"actor_{name}": np.array([getattr(actor, name) for actor in self.actors])
            for name in names
        }
        return {
            "tick_s": np.array(self.tick_s),
            "first_tick": np.array(self.first_tick),
            **{f"state_{name}": self.states[name] for name in columns},
            "signal_ids": np.array(self.signal_ids, dtype=np.str_),
            "signals": self.signals,
            **table,
        }

    @staticmethod
    def load(path: Path) -> "Trace":
        """Read a file written by `save`.

        Raises:
            RunError: It is something else, or damaged.
        """
        columns = load_arrays(path, max_bytes=MAX_TRACE_BYTES)
        try:
            columns.setdefault("actor_towed_by", np.zeros_like(columns["actor_id"]))
            for name in ROLL_COLUMNS:
                columns.setdefault(f"state_{name}", np.zeros_like(columns["state_pitch"]))
            _check_columns(columns)
            trace = _build_trace(columns)
            _check_trace(trace)
        except (ValueError, KeyError) as error:
            raise RunError(f"{path}: not a trace: {error}") from error
        return trace


MAX_TRACE_BYTES = 10**9
MAX_ACTOR_SIZE_M, MAX_TICK_S = 100.0, 10.0
MAX_STATE_VALUE = 1e7
"""Beyond all ticks, metres, radians and speeds of a scenario."""
_COLUMNS: dict[str, tuple[str, int]] = {
    **{"tick_s": ("f", 0), "first_tick": ("i", 0), "signal_ids": ("U", 1), "signals": ("u", 2)},
    **{f"actor_{name}": ("U", 1) for name in ("actor_class", "blueprint", "paint")},
    **{"actor_id": ("i", 1), "actor_size": ("f", 2), "actor_towed_by": ("i", 1)},
    **{f"state_{name}": (STATE_DTYPE[name].kind, 1) for name in STATE_COLUMNS},
}
"""Kind and number of dimensions of every array of a trace's file."""


def _check_columns(columns: Mapping[str, NDArray[Any]]) -> None:
    """Raise ValueError or KeyError if an array is missing, or of another kind or length."""
    for name, (kind, dimensions) in _COLUMNS.items():
        column = columns[name]
        if (column.dtype.kind, column.ndim) != (kind, dimensions):
            raise ValueError(f"{name} is {column.dtype} with {column.ndim} dimensions")
        if kind == "f" and not np.isfinite(column).all():
            raise ValueError(f"{name} is not finite")
    for name in STATE_COLUMNS:
        if columns[f"state_{name}"].dtype != STATE_DTYPE[name]:
            raise ValueError(f"state_{name} is not {STATE_DTYPE[name]}")
    for table in ("state_", "actor_"):
        if len({len(columns[name]) for name in _COLUMNS if name.startswith(table)}) > 1:
            raise ValueError(f"{table}... differ in length")
    if columns["signals"].shape[1] != len(columns["signal_ids"]):
        raise ValueError("signals without ids")
    if columns["actor_size"].shape[1] != 3:
        raise ValueError("sizes without three numbers")


def _build_trace(columns: Mapping[str, NDArray[Any]]) -> Trace:
    table = {item.name: columns[f"actor_{item.name}"].tolist() for item in fields(Actor)}
    table["size"] = [tuple(size) for size in table["size"]]
    states = np.empty(len(columns["state_tick"]), STATE_DTYPE)
    for name in STATE_COLUMNS:
        states[name] = columns[f"state_{name}"]
    return Trace(
        tick_s=float(columns["tick_s"]),
        first_tick=int(columns["first_tick"]),
        actors=tuple(Actor(*values) for values in zip(*table.values(), strict=True)),
        states=states,
        signal_ids=tuple(columns["signal_ids"].tolist()),
        signals=columns["signals"],
    )


def _check_trace(trace: Trace) -> None:
    """Raise ValueError if values are impossible in traffic."""
    ticks, actors = (trace.states[name].astype(np.int64) for name in ("tick", "actor"))
    sizes = np.array([actor.size for actor in trace.actors])
    ids = [actor.id for actor in trace.actors]
    order = ticks * max(1, len(ids)) + actors
    numbers = [trace.states[name] for name in STATE_COLUMNS]
    checks = {
        "a state": all(np.abs(column).max(initial=0) < MAX_STATE_VALUE for column in numbers),
        "length of a tick": 0 < trace.tick_s <= MAX_TICK_S and trace.first_tick >= 0,
        "ticks of states": not len(ticks) or 0 <= ticks.min() <= ticks.max() < len(trace),
        "actors of states": not len(actors) or 0 <= actors.min() <= actors.max() < len(ids),
        "order of states": bool((np.diff(order) > 0).all()),
        "ids of actors": len({*ids}) == len(ids) and all(number > 0 for number in ids),
        "towing of actors": {one.towed_by for one in trace.actors if one.towed_by} <= {*ids},
        "classes of actors": {one.actor_class for one in trace.actors} <= {*get_args(ActorClass)},
        "sizes of actors": bool(((sizes > 0) & (sizes < MAX_ACTOR_SIZE_M)).all()),
        "signals": not trace.signals.size or trace.signals.max() <= max(Signal),
    }
    for what, is_right in checks.items():
        if not is_right:
            raise ValueError(f"{what} cannot be right")


def _build_motion(row: NDArray[np.void]) -> BodyMotion:
    pitch, roll = row["pitch"], row["roll"]
    # About the axes of the body, not yet rolled.
    level_rate, upright_rate = row["pitch_rate"], row["yaw_rate"] * np.cos(pitch)
    return BodyMotion(
        velocity=np.array([row["vx"], row["vy"], row["vz"]]),
        acceleration=np.array([row["ax"], row["ay"], row["az"]]),
        angular_rate=np.array(
            [
                row["roll_rate"] - row["yaw_rate"] * np.sin(pitch),
                level_rate * np.cos(roll) + upright_rate * np.sin(roll),
                upright_rate * np.cos(roll) - level_rate * np.sin(roll),
            ]
        ),
    )


def extract_planned_trajectory(
    trace: Trace, actor_id: int, index: int, *, point_count: int = 9, step_s: float = 0.2
) -> NDArray[np.float64]:
    """Extract an actor's next points from its trace.

    Beyond its last tick the actor is assumed to go straight on at its last speed.

    Args:
        trace: The traffic.
        actor_id: Id of the actor.
        index: Kept tick at which the trajectory begins.
        point_count: Number of points.
        step_s: Time between points.

    Returns:
        (points, 3): world x and y in metres and speed in m/s, `step_s` apart, the first one
        `step_s` ahead.

    Raises:
        KeyError: The trace does not have the actor at that tick.
    """
    _, track = trace.get_track(actor_id)
    track = track[track["tick"] >= index]
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
"""An actor at one tick as SUMO has it: centre of its front bumper in m, heading and slope of its
lane in rad, speed in m/s, acceleration in m/s², `Lamp` bits."""

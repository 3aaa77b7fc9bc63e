"""The motion of vehicles: a body follows its front axle, and a semi-trailer its tractor unit."""

import math
from dataclasses import dataclass
from functools import cached_property, partial

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from advercity.frames import WHEELBASE_FRACTION
from advercity.geometry.plane import compute_headings, compute_lengths
from advercity.traffic.banking import Lean, stay_upright
from advercity.traffic.body_states import (
    CATCH_UP_FACTOR,
    BodyCurves,
    apply_brake_lamps,
    build_states,
    compute_steering,
)
from advercity.traffic.motion_spline import EASING_TICKS, HeightProfile, MotionSpline, Values
from advercity.traffic.semitrailers import TowedTrailer

DRIVING_SMOOTHING_TICKS = 14
"""Ticks over which vehicles change their acceleration.

Between the usual extremes of acceleration and braking, 2.5 and -3 m/s², jerk along the path stays
below 4 m/s³. With up to 3 m/s³ across it, as in a turn, it stays below 5."""
EMERGENCY_SMOOTHING_TICKS = 6
"""Ticks over which vehicles change the emergency part of it; jerk stays below 20 m/s³."""


EMERGENCY_M_S2 = 3.1
"""Minimum change of speed of an emergency."""


@dataclass(frozen=True, eq=False)
class _PulledBody:
    """A body pulled at a point; its axle behind the point rolls and never slides.

    Its direction u turns at the rate r with u' = i r u, where r is the part of the point's velocity
    across u, over the wheelbase.

    Attributes:
        pull: (3, n) place of the point in the plan, velocity and acceleration.
        directions: (n,) unit vectors ahead.
        pull_z: (3, n) height of the ground under the point, with derivatives.
        axle_z: (3, n) height of the ground under the axle, with derivatives.
        wheelbase_m: Distance of the axle behind the point.
    """

    pull: NDArray[np.complex128]
    directions: NDArray[np.complex128]
    pull_z: NDArray[np.float64]
    axle_z: NDArray[np.float64]
    wheelbase_m: float

    @cached_property
    def turning(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Rates (n,) and angular accelerations (n,) of the direction."""
        _, velocity, acceleration = self.pull
        rates = _across(self.directions, velocity) / self.wheelbase_m
        along = rates * _along(self.directions, velocity)
        return rates, (_across(self.directions, acceleration) - along) / self.wheelbase_m

    def locate_behind(self, back_m: float) -> NDArray[np.complex128]:
        """Compute the motion (3, n) in the plan of a point behind the pulled one."""
        (rates, turns), arm = self.turning, back_m * self.directions
        return self.pull - np.stack([arm, 1j * rates * arm, (1j * turns - rates**2) * arm])

    def find_height_behind(self, back_m: float) -> NDArray[np.float64]:
        """Compute the motion (3, n) of the ground's height there."""
        part = back_m / self.wheelbase_m
        return (1 - part) * self.pull_z + part * self.axle_z

    def compute_arm(self, ahead_m: float) -> NDArray[np.complex128]:
        """Compute (3, n) in the plan the arm to a point ahead on the body, shorter on a slope."""
        rates, turns = self.turning
        climb, climb_rate, climb_turn = self._climb
        level = 1 / np.sqrt(1 + climb**2)
        level_rate = -climb * climb_rate * level * level * level
        level_turn = (3 * (climb * climb_rate * level) ** 2 - climb_rate**2) * level * level * level
        level_turn -= climb * climb_turn * level * level * level
        radial, across = level_turn - level * rates**2, 2 * level_rate * rates + level * turns
        changes = [level, level_rate + 1j * rates * level, radial + 1j * across]
        return ahead_m * self.directions * np.stack(changes)

    @property
    def _climb(self) -> NDArray[np.float64]:
        """Slope (3, n) of the body, with derivatives."""
        return (self.pull_z - self.axle_z) / self.wheelbase_m

    def compute_motion(self, plan: NDArray[np.complex128], back_m: float) -> BodyCurves:
        """Compute the motion of the body from its origin's (3, n), `back_m` behind the point."""
        climb, climb_rate, _ = self._climb
        return BodyCurves(
            plan=plan,
            height=self.find_height_behind(back_m),
            yaw=np.stack([np.unwrap(compute_headings(self.directions)), self.turning[0]]),
            pitch=-np.stack([compute_headings(1 + 1j * climb), climb_rate / (1 + climb**2)]),
            roll=np.zeros((2, len(self.directions))),
        )


def compute_vehicle_states(
    track: NDArray[np.void],
    length_m: float,
    *,
    tick_s: float,
    lean: Lean = stay_upright,
) -> NDArray[np.void]:
    """Compute the states of one vehicle from its fronts, both sorted by tick.

    The front axle follows the path of the front bumper and pulls the rear axle behind it, which
    rolls and never slides (a tractrix): so the body cuts corners as real ones do. An axle has the
    height of the front when it passed there; before the first tick the lane continues at its slope.
    Brake lamps are lit while the vehicle slows down and while it is held at standstill.

    Args:
        track: (n,) of `FRONT_DTYPE`; of yaw and slope only the first row counts.
        length_m: Length of the body.
        tick_s: Length of a tick.
        lean: Rolls it with the road.

    Returns:
        (n,) of `STATE_DTYPE`, with `actor` left at 0.
    """
    body, _ = _pull_vehicle(track, length_m, tick_s)
    return _build_vehicle_states(track, body, lean)


def compute_lorry_states(
    track: NDArray[np.void],
    length_m: float,
    trailer: TowedTrailer,
    *,
    tick_s: float,
    trailer_heading_rad: float,
    lean: Lean = stay_upright,
) -> tuple[NDArray[np.void], NDArray[np.void]]:
    """Compute the states of a tractor unit and its semi-trailer from the fronts of the lorry.

    The tractor unit moves as other vehicles do. At its fifth wheel it pulls the kingpin of the
    semi-trailer, whose axles roll and never slide (a tractrix): its yaw changes at v/L sin(b) with
    the speed v of the kingpin, the wheelbase L and the angle b from the semi-trailer to that speed.
    Both have the same lamps.

    Args:
        track: (n,) of `FRONT_DTYPE`; of yaw and slope only the first row counts.
        length_m: Length of the tractor unit.
        trailer: The semi-trailer.
        tick_s: Length of a tick.
        trailer_heading_rad: Heading of the semi-trailer at the first tick.
        lean: Rolls both with the road.

    Returns:
        (n,) and (n,) of `STATE_DTYPE`, with `actor` left at 0.
    """
    tractor, axles_z = _pull_vehicle(track, length_m, tick_s, trailer)
    overhang_m, wheelbase_m = _measure_axles(length_m)
    coupling = tractor.compute_arm(length_m / 2 - trailer.fifth_wheel_m)
    pull = tractor.locate_behind(wheelbase_m / 2) + coupling
    _, velocity, acceleration = pull
    # The cubic with the velocities and accelerations of both ticks.
    middles = (velocity[:-1] + velocity[1:]) / 2 - tick_s / 8 * np.diff(acceleration)
    towed = _PulledBody(
        pull=pull,
        directions=_compute_tractrix_directions(
            velocity, middles, tick_s, trailer.wheelbase_m, np.exp(1j * trailer_heading_rad)
        ),
        pull_z=tractor.find_height_behind(trailer.fifth_wheel_m - overhang_m),
        axle_z=axles_z,
        wheelbase_m=trailer.wheelbase_m,
    )
    kingpin_m = trailer.actor.size[0] / 2 - trailer.kingpin_m
    motion = towed.compute_motion(pull - towed.compute_arm(kingpin_m), kingpin_m)
    states = _build_vehicle_states(track, tractor, lean)
    return states, build_states(track["tick"], states["lamps"], lean(motion))


def _measure_axles(length_m: float) -> tuple[float, float]:
    """Measure the distances from the front to the front axle, and from there to the rear axle."""
    wheelbase_m = WHEELBASE_FRACTION * length_m
    return (length_m - wheelbase_m) / 2, wheelbase_m


def _build_vehicle_states(
    track: NDArray[np.void], body: _PulledBody, lean: Lean
) -> NDArray[np.void]:
    """Build the states of a vehicle; its origin is between its axles."""
    middle_m = body.wheelbase_m / 2
    motion = lean(body.compute_motion(body.locate_behind(middle_m), middle_m))
    states = build_states(track["tick"], track["lamps"], motion)
    states["steering"] = compute_steering(body.pull[1], body.directions)
    apply_brake_lamps(states)
    return states


def _pull_vehicle(
    track: NDArray[np.void], length_m: float, tick_s: float, trailer: TowedTrailer | None = None
) -> tuple[_PulledBody, NDArray[np.float64]]:
    """Pull a vehicle at its front axle along the path of its front.

    Returns:
        The vehicle; and (3, n) the height under the semi-trailer's axles, else its rear axle.
    """
    fronts = _follow_targets(
        track["x"] + 1j * track["y"], CATCH_UP_FACTOR * track["speed"] * tick_s
    )
    along = np.cumsum(compute_lengths(np.diff(fronts, prepend=fronts[0])))
    overhang, wheelbase = _measure_axles(length_m)
    ahead = np.exp(1j * track["yaw"][0])
    first_m = track["speed"][0] * tick_s
    gains = _find_emergency_gains(track["speed"], tick_s)
    smooth = partial(_smooth_driving, tick_s=tick_s, gains=gains)
    place = _interpolate_behind(fronts, along, overhang, fronts[0] - overhang * ahead)
    profile = HeightProfile.from_samples(
        along,
        track["z"],
        first_m=-2 * (trailer.lorry_length_m if trailer else length_m),
        first_grade=math.tan(track["slope"][0]),
    )

    def find_height(back_m: float) -> NDArray[np.float64]:
        return profile.compute_derivatives(smooth(along - back_m, first_step=first_m))

    axle = smooth(place, first_step=first_m * ahead)
    rear_z = find_height(overhang + wheelbase)
    body = _PulledBody(
        pull=axle.derivatives,
        directions=_compute_tractrix_directions(
            axle.rates, axle.middle_rates, tick_s, wheelbase, ahead
        ),
        pull_z=find_height(overhang),
        axle_z=rear_z,
        wheelbase_m=wheelbase,
    )
    return body, find_height(trailer.axles_behind_front_m) if trailer else rear_z


def _find_emergency_gains(speed: NDArray[np.float64], tick_s: float) -> NDArray[np.float64]:
    """Find the part (n,) of each tick's change of step that occurs only in emergencies.

    SUMO's drivers in doubt brake hard for single ticks and accelerate in between. An emergency
    exceeds the usual even after smoothing.
    """
    gains = np.diff(speed, append=speed[-1]) * tick_s
    usual = EMERGENCY_M_S2 * tick_s**2
    smoothed = MotionSpline.from_samples(speed, tick_s, ticks=EMERGENCY_SMOOTHING_TICKS)
    is_hard = np.abs(smoothed.rates) > EMERGENCY_M_S2
    spread = (EMERGENCY_SMOOTHING_TICKS + EASING_TICKS) // 2
    is_near = sliding_window_view(np.pad(is_hard, spread), 2 * spread + 1).any(axis=1)
    return np.where(is_near, gains - np.clip(gains, -usual, usual), 0.0)


def _smooth_driving(
    samples: Values, tick_s: float, gains: NDArray[np.float64], first_step: complex
) -> MotionSpline:
    """Smooth values (n,), continued beyond the last tick with the last step.

    Emergencies (`gains`) are smoothed less, in the direction of the motion.
    """
    steps = np.diff(samples, prepend=samples[0] - first_step)
    daily = MotionSpline.from_samples(
        samples,
        tick_s,
        ticks=DRIVING_SMOOTHING_TICKS,
        first_step=first_step,
        last_step=steps[-1],
    )
    if not gains.any():
        return daily
    moves = steps + np.append(steps[1:], steps[-1])
    ahead = moves / np.maximum(compute_lengths(moves), 1e-9)
    return daily.hasten(
        gains * ahead, ticks=DRIVING_SMOOTHING_TICKS, to_ticks=EMERGENCY_SMOOTHING_TICKS
    )


def _follow_targets(
    targets: NDArray[np.complex128], max_step: NDArray[np.float64]
) -> NDArray[np.complex128]:
    """Compute positions (n,) following the targets by steps of at most `max_step` (n,)."""
    position = complex(targets[0])
    path: list[complex] = []
    for target, limit in zip(targets.tolist(), max_step.tolist(), strict=True):
        gap = target - position
        position = target if abs(gap) <= limit else position + gap / abs(gap) * limit
        path.append(position)
    return np.array(path)


def _interpolate_behind(
    values: NDArray[np.complex128], along: NDArray[np.float64], back_m: float, before: complex
) -> NDArray[np.complex128]:
    """Interpolate values (n,) `back_m` behind each station (n,).

    `before` is the value `back_m` before the first station, not included in the path.
    """
    stations, known = np.concatenate([[-back_m], along]), np.concatenate([[before], values])
    return np.asarray(np.interp(along - back_m, stations, known), dtype=np.complex128)


def _along(
    direction: NDArray[np.complex128], vector: NDArray[np.complex128]
) -> NDArray[np.float64]:
    """Compute the parts (n,) of vectors along unit vectors."""
    return direction.real * vector.real + direction.imag * vector.imag


def _across(
    direction: NDArray[np.complex128], vector: NDArray[np.complex128]
) -> NDArray[np.float64]:
    """Compute the parts (n,) of vectors to the left of unit vectors."""
    return direction.real * vector.imag - direction.imag * vector.real


def _compute_tractrix_directions(
    velocities: NDArray[np.complex128],
    middles: NDArray[np.complex128],
    tick_s: float,
    wheelbase_m: float,
    first: complex,
) -> NDArray[np.complex128]:
    """Compute the directions (n,) of a pulled body with an axle behind (a tractrix).

    Velocities are the pulled point's at ticks (n,) and in the middle between them (n - 1,). Each
    tick is a step of Runge and Kutta's method of the fourth order.
    """

    def turn(direction: complex, velocity: complex) -> complex:
        return 1j * direction * (direction.conjugate() * velocity).imag / wheelbase_m

    direction, directions, step = complex(first), [complex(first)], tick_s
    rates = velocities.tolist()
    for begin, middle, end in zip(rates, middles.tolist(), rates[1:], strict=False):
        one = turn(direction, begin)
        two = turn(direction + step / 2 * one, middle)
        three = turn(direction + step / 2 * two, middle)
        four = turn(direction + step * three, end)
        change = step / 6 * (one + 2 * two + 2 * three + four)
        if change:  # at rest a body does not turn, not even by rounding
            direction += change
            direction /= abs(direction)
        directions.append(direction)
    return np.array(directions)

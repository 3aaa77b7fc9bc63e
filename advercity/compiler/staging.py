"""Solve conflicts: where the ways meet, who comes from where, and how fast."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from advercity_dsl import Blueprint, Conflict, Road, StagedActor, StagedConflict
from advercity_dsl.road import Movement, StripKind
from numpy.typing import NDArray

from advercity.compiler.nominal import Pace, nominal
from advercity.compiler.occlusion import outline, seen_from_m
from advercity.compiler.sampling import sampled
from advercity.compiler.ways import RoadWays, Stretch, Way, ego_of, ego_way
from advercity.randomness import generator

FIRST_VEHICLE, FIRST_WALKER = 4001, 8001
NUMBERS_PER_CONFLICT = 10
BEFORE_LINE_M = 1.0
"""Between a waiting vehicle and the stop line."""
BESIDE_LANE_M = 0.8
"""Between the edge of the lanes and one who waits to cross."""
RUN_UP_M = {"pedestrian": 0.0, "bicycle": 6.0}
"""Farther back from there that somebody sets out."""
CROSSING_BEFORE_M = 2.1
"""From the middle of a crossing to the end of its street, inside the junction."""
ALONGSIDE_M = 26.0
BESIDE_EGO_M = 0.3
"""One who rides beside the ego keeps this much more to the right than others."""
FIRST_PLACE, NEXT_PLACE = 0.55, 0.3
"""Of the ego's way, where it is crossed between junctions, and how much farther on next time."""
CLEAR_OF_JUNCTIONS_M = 8.0
STEADY_SHARE = 0.88
"""Of the most that it could reach and stop again, so that it keeps its speed for a moment."""
WAITS_S = 1.5
"""An oncoming actor starts so near that it can wait this long, to be in time."""
PASSED_WAITS_S = 1.0
"""The same for whom it overtakes."""
BACK_BEFORE_S = 0.15
"""It is back in its lane this long before it is beside the ego."""
EARLIEST_S = 8.8
"""The ego meets nobody sooner; what leads to it is not lost in the warm-up."""
MIDDLE = (0.25, 0.62)
"""Shares of the ego's way between which it meets somebody oncoming."""
CYCLIST_M_S2 = (1.0, 2.0)
"""With which a cyclist sets out and brakes."""
STEPS_ASIDE = 0.35
"""How far one who leaves the ego's way walks on for each metre to the side."""
WORDS = {"pedestrian": "walker", "bicycle": "cyclist"}


class UnsolvableError(ValueError):
    """A conflict that does not fit a road after all; the message says why."""


@dataclass(frozen=True)
class Placed:
    """A way for an actor that meets the ego's.

    Attributes:
        station_m: On the ego's way, where both meet.
        path: Points of a path of its own, or none.
        route: Streets of a route in lanes, or none.
        lane: Of its first street.
        start_m: Of its middle before the end of that street.
        room_m: From its start to the point.
    """

    station_m: float
    room_m: float
    path: NDArray[np.float64] | None = None
    route: tuple[str, ...] = ()
    lane: int = 1
    start_m: float = 0.0


def solved(
    conflict: Conflict,
    typology: str,
    road: Road,
    blueprints: Mapping[str, Blueprint],
    *,
    seed: int,
    key: str,
    index: int,
) -> StagedConflict:
    """A conflict at a road, with numbers in place of distributions.

    Args:
        conflict: What to stage.
        typology: Id of the typology that its crash types belong to.
        road: Where; the ego makes the conflict's manoeuvre on it.
        blueprints: To draw the actor's from.
        seed: Of the suite.
        key: What the draws are for: road, conflict and density, whatever the weather.
        index: Place among the scenario's conflicts, from 1.

    Raises:
        UnsolvableError: It does not fit.
    """
    return _Solver(conflict, typology, road, blueprints, seed, key, index).solve()


@dataclass(frozen=True)
class _Solver:
    conflict: Conflict
    typology: str
    road: Road
    blueprints: Mapping[str, Blueprint]
    seed: int
    key: str
    index: int

    def solve(self) -> StagedConflict:
        drawn = sampled(self.conflict.parameters, self.seed, self.key)
        placed = self._placed(drawn)
        speed = self._speed(placed, drawn)
        drawn["actor_speed_km_h"] = round(speed * 3.6, 3)
        drawn["approach_m"] = round(placed.room_m, 2)
        bystanders = self._bystanders(placed, drawn)
        found = drawn | self._occlusion(placed, speed, bystanders)
        at_s = self.pace.time(placed.station_m)
        here = self.way.at(placed.station_m)
        return StagedConflict(
            id=f"conflict_{self.index}",
            conflict=self.conflict.id,
            typology=self.typology,
            stages=self.conflict.stages,
            ego=self.conflict.ego.part,
            manoeuvre=self.conflict.ego.manoeuvre,
            violates=self.conflict.actor.violates,
            actors=(self._actor(placed, drawn, speed), *bystanders),
            point_m=_point(here),
            station_m=round(placed.station_m - self.start_m, 3),
            window_s=(round(at_s - 1.5, 1), round(at_s + 1.5, 1)),
            parameters=dict(sorted(found.items())),
            mode="open_loop",
            outcome=self.conflict.outcome,
        )

    @cached_property
    def ways(self) -> RoadWays:
        return RoadWays(self.road)

    @cached_property
    def _ego(self) -> tuple[Way, float, float]:
        return ego_way(self.ways, ego_of(self.road))

    @property
    def way(self) -> Way:
        return self._ego[0]

    @property
    def start_m(self) -> float:
        return self._ego[1]

    @property
    def end_m(self) -> float:
        return self._ego[2] - 10.0

    @cached_property
    def pace(self) -> Pace:
        return nominal(self.road, self.ways, self.way, self.start_m)

    @cached_property
    def _body(self) -> tuple[str, Blueprint]:
        classes = [
            name
            for name in self.conflict.actor.classes
            if any(item.actor_class == name for item in self.blueprints.values())
        ]
        if not classes:
            raise UnsolvableError(
                f"no blueprint of the class {' or '.join(self.conflict.actor.classes)} is there"
            )
        draw = generator(self.seed, "conflict", self.key, "blueprint")
        chosen = classes[int(draw.integers(len(classes)))]
        names = [name for name, item in self.blueprints.items() if item.actor_class == chosen]
        name = names[int(draw.integers(len(names)))]
        return name, self.blueprints[name]

    def _speed(self, placed: Placed, drawn: Mapping[str, float]) -> float:
        """The drawn speed, or the most from which it can still stop short."""
        wanted = drawn["actor_speed_km_h"] / 3.6
        if self.conflict.actor.behaviour != "stops_short":
            return wanted
        room = placed.room_m - self._body[1].length_m / 2 - 2.2
        gains, loses = drawn["acceleration_m_s2"], drawn["braking_m_s2"]
        most = np.sqrt(2 * max(room, 0.0) / (1 / gains + 1 / loses))
        return round(float(min(wanted, STEADY_SHARE * most)), 3)

    def _actor(self, placed: Placed, drawn: Mapping[str, float], speed: float) -> StagedActor:
        name, body = self._body
        word = WORDS.get(body.actor_class, "vehicle")
        return StagedActor(
            id=f"conflict_{self.index}_{word}",
            number=self._number(body.actor_class, 0),
            part="other" if self.conflict.ego.part == "subject" else "subject",
            behaviour=self.conflict.actor.behaviour,
            actor_class=body.actor_class,
            blueprint=name,
            route=placed.route,
            lane=placed.lane,
            path_m=() if placed.path is None else tuple(_point(item) for item in placed.path),
            start_m=round(placed.start_m, 3),
            speed_m_s=speed,
            acceleration_m_s2=drawn["acceleration_m_s2"],
            braking_m_s2=drawn["braking_m_s2"],
        )

    def _number(self, actor_class: str, offset: int) -> int:
        first = FIRST_WALKER if actor_class == "pedestrian" else FIRST_VEHICLE
        return first + NUMBERS_PER_CONFLICT * (self.index - 1) + offset

    def _bystanders(self, placed: Placed, drawn: Mapping[str, float]) -> tuple[StagedActor, ...]:
        if self.conflict.actor.behaviour == "overtakes":
            return (self._passed(placed, drawn),)
        if "obstruction_gap_m" not in drawn:
            return ()
        cars = [name for name, item in self.blueprints.items() if item.actor_class == "car"]
        stretch = self._stretch(placed.station_m)
        lateral = _outer_edge(stretch, right=True) - 0.15
        parked: list[StagedActor] = []
        ahead = placed.station_m - self._body[1].width_m / 2 - drawn["obstruction_gap_m"]
        for offset in (1, 2):
            draw = generator(self.seed, "conflict", self.key, "parked", offset)
            name = cars[int(draw.integers(len(cars)))]
            body = self.blueprints[name]
            side = lateral - body.width_m / 2
            ends = [self.way.at(ahead - body.length_m, side), self.way.at(ahead, side)]
            parked.append(
                StagedActor(
                    id=f"conflict_{self.index}_parked_{offset}",
                    number=self._number("car", offset),
                    part="bystander",
                    behaviour="stands",
                    actor_class="car",
                    blueprint=name,
                    path_m=tuple(_point(item) for item in ends),
                    speed_m_s=0.0,
                    acceleration_m_s2=1.0,
                    braking_m_s2=1.0,
                )
            )
            ahead -= body.length_m + 1.0
        return tuple(parked)

    def _occlusion(
        self, placed: Placed, speed: float, bystanders: Iterable[StagedActor]
    ) -> dict[str, float]:
        """From where the ego sees an actor behind parked cars, if there are any."""
        parked = [
            outline(np.array(item.path_m), self.blueprints[item.blueprint].width_m)
            for item in bystanders
            if item.behaviour == "stands"
        ]
        if not parked or placed.path is None:
            return {}
        seen_m = seen_from_m(self.way, self.pace, placed.station_m, placed.path, speed, parked)
        return {} if seen_m is None else {"occlusion_m": round(seen_m, 2)}

    def _placed(self, drawn: Mapping[str, float]) -> Placed:
        match self.conflict.actor.comes:
            case "nearside" | "farside" as side:
                return self._across(drawn, nearside=side == "nearside")
            case "ahead":
                return self._ahead(drawn)
            case "opposite_lane":
                return self._opposite(drawn)
            case "alongside":
                return self._alongside()
            case "oncoming" if self._body[1].actor_class == "bicycle":
                return self._oncoming_edge()
            case _:
                return self._through()

    def _across(self, drawn: Mapping[str, float], *, nearside: bool) -> Placed:
        station = self._place()
        stretch = self._stretch(station)
        sign = -1.0 if nearside else 1.0
        wait = max(self._waiting(stretch, right=nearside), drawn.get("start_lateral_m", 0.0))
        start = wait + RUN_UP_M.get(self._body[1].actor_class, 0.0)
        beyond = self._waiting(stretch, right=not nearside) + 1.0
        ends = [self.way.at(station, sign * start), self.way.at(station, -sign * beyond)]
        return Placed(station, start, path=np.array(ends))

    def _waiting(self, stretch: Stretch, *, right: bool) -> float:
        """Distance from the ego's way to where one waits: beside the lanes, on foot on a median."""
        rides = self._body[1].actor_class == "bicycle"
        return abs(_outer_edge(stretch, right=right, to_median=not rides)) + BESIDE_LANE_M

    def _place(self) -> float:
        """Where on its way the ego is crossed: on the exit crossing, or where somebody can park."""
        if self.road.junction == "intersection":
            after = self.way.stretches[1]
            if self.conflict.parameters.obstruction_gap_m is None:
                return after.begins_m - CROSSING_BEFORE_M
            return (after.begins_m + min(after.ends_m, self.end_m)) / 2
        share = FIRST_PLACE + (self.index - 1) * NEXT_PLACE
        wanted = self.start_m + share * (self.end_m - self.start_m)
        parts = [
            (max(item.begins_m, self.start_m) + min(item.ends_m, self.end_m)) / 2
            for item in self.way.stretches
        ]
        inside = any(
            item.begins_m + CLEAR_OF_JUNCTIONS_M < wanted < item.ends_m - CLEAR_OF_JUNCTIONS_M
            for item in self.way.stretches
        )
        return wanted if inside else min(parts, key=lambda part: abs(part - wanted))

    def _stretch(self, station: float) -> Stretch:
        return next(
            item
            for item in reversed(self.way.stretches)
            if item.begins_m - CROSSING_BEFORE_M - 0.1 <= station
        )

    def _ahead(self, drawn: Mapping[str, float]) -> Placed:
        station = self._place()
        stretch = self._stretch(station)
        right = not any(
            band.kind is StripKind.LANE and band.number > stretch.lane
            for band in stretch.bands(right=True)
        )
        out = (self._waiting(stretch, right=right)) * (-1 if right else 1)
        speed = drawn["actor_speed_km_h"] / 3.6
        lead = speed * drawn["return_time_s"]
        back = min(speed * (self.pace.time(station) + 2.0), station - self.start_m + 20.0)
        aside = station - lead + STEPS_ASIDE * abs(out)
        stations = [station - back, station - lead, aside, station + 15.0]
        sides = [0.15 * out, 0.15 * out, out, out]
        points = [self.way.at(s, side) for s, side in zip(stations, sides, strict=True)]
        return Placed(station, back, path=np.array(points))

    def _opposite(self, drawn: Mapping[str, float]) -> Placed:
        """From ahead in the other lane, so far that both meet near the middle of the ego's way."""
        overtakes = self.conflict.actor.behaviour == "overtakes"
        station = self._soonest(drawn) if overtakes else self._straightest()
        speed, gains = drawn["actor_speed_km_h"] / 3.6, drawn["acceleration_m_s2"]
        run = speed * (self.pace.time(station) - speed / (2 * gains) - WAITS_S)
        return self._oncoming(station, run)

    def _oncoming(self, station: float, run_m: float) -> Placed:
        """Against the ego in its lane, so far before a place on the ego's way."""
        route = tuple(reversed(ego_of(self.road).route))
        route = (*route, *self._onward(route[-1]))
        back = self.ways.route(route)
        meets = back.nearest(self.way.at(station))
        start = max(meets - run_m, 8.0)
        index, stretch = next(
            (number, item) for number, item in enumerate(back.stretches) if start < item.ends_m - 8
        )
        start = max(start, stretch.begins_m + 8.0)
        return Placed(
            station,
            meets - start,
            route=route[index:],
            start_m=stretch.ends_m - start,
        )

    def _soonest(self, drawn: Mapping[str, float]) -> float:
        """The first place on the ego's way where one who overtakes can have done so."""
        sets_out_s = drawn["actor_speed_km_h"] / 3.6 / drawn["acceleration_m_s2"]
        beside_s = self._beside_s(drawn)
        after_s = WAITS_S + sets_out_s + drawn["drift_time_s"] + beside_s + self._back_s(drawn)
        return self.pace.station(after_s)

    def _back_s(self, drawn: Mapping[str, float]) -> float:
        return drawn["return_time_s"] + BACK_BEFORE_S

    def _beside_s(self, drawn: Mapping[str, float]) -> float:
        """How long one who overtakes drives beside its lane."""
        lengths = self._body[1].length_m + self._cyclist[1].length_m
        closing = (drawn["actor_speed_km_h"] - drawn["passed_speed_km_h"]) / 3.6
        if closing <= 0:
            raise UnsolvableError("whom it overtakes is not slower")
        return (lengths + 2 * drawn["passing_gap_m"]) / closing

    @cached_property
    def _cyclist(self) -> tuple[str, Blueprint]:
        """Who is overtaken."""
        names = [name for name, item in self.blueprints.items() if item.actor_class == "bicycle"]
        if not names:
            raise UnsolvableError("no blueprint of the class bicycle is there to be overtaken")
        name = names[int(generator(self.seed, "conflict", self.key, "passed").integers(len(names)))]
        return name, self.blueprints[name]

    def _passed(self, placed: Placed, drawn: Mapping[str, float]) -> StagedActor:
        """The cyclist whom the actor passes as it begins to come back into its lane."""
        name, body = self._cyclist
        speed, pace = drawn["actor_speed_km_h"] / 3.6, drawn["passed_speed_km_h"] / 3.6
        back_s = self._back_s(drawn)
        before = speed * back_s + (self._body[1].length_m + body.length_m) / 2
        before += drawn["passing_gap_m"]
        rides_s = self.pace.time(placed.station_m) - back_s - PASSED_WAITS_S
        rode = pace * (rides_s - pace / (2 * CYCLIST_M_S2[0]))
        from_here = self._oncoming(placed.station_m, before + rode)
        return StagedActor(
            id=f"conflict_{self.index}_passed",
            number=self._number("bicycle", 1),
            part="bystander",
            behaviour="drives",
            actor_class="bicycle",
            blueprint=name,
            route=from_here.route,
            start_m=round(from_here.start_m, 3),
            speed_m_s=round(pace, 3),
            acceleration_m_s2=CYCLIST_M_S2[0],
            braking_m_s2=CYCLIST_M_S2[1],
        )

    def _straightest(self) -> float:
        """Near the middle of the ego's way, where an actor that drifts comes towards it straight.

        On a bend nobody could tell a drift from its velocity alone.
        """
        places = self.start_m + np.linspace(*MIDDLE, 41) * (self.end_m - self.start_m)
        stations = [at for at in places.tolist() if self.pace.time(at) >= EARLIEST_S]
        turns = [
            np.ptp(np.unwrap([self.way.heading(s) for s in np.arange(at - 5.0, at + 32.0, 4.0)]))
            for at in stations
        ]
        return stations[int(np.argmin(np.round(turns, 2)))]

    def _onward(self, street: str) -> tuple[str, ...]:
        """The street that the ego's first one is driven to, against the ego; none at the edge."""
        ego = ego_of(self.road)
        along = self.ways.along(ego.route, 0)
        layout = self.ways.streets[street]
        junction = layout.begins if along else layout.ends
        options = [
            item for item in self.ways.movements.get(junction, ()) if item.from_street == street
        ]
        straightest = sorted(options, key=lambda item: abs(self.ways.turn(item, junction)))
        return tuple(item.to_street for item in straightest[:1])

    @cached_property
    def _junction(self) -> str:
        route = ego_of(self.road).route
        junction = self.ways.junction_between(route[0], route[1]) if len(route) > 1 else None
        if junction is None:
            raise UnsolvableError("the ego passes no junction there")
        return junction

    def _straight_from(self, bearing: float) -> tuple[Movement, ...]:
        """Movements straight through the junction by those who come at an angle to the ego."""
        mine = self.ways.inbound(ego_of(self.road).route[0], self._junction)
        found: list[Movement] = []
        for item in self.ways.movements[self._junction]:
            relative = self.ways.inbound(item.from_street, self._junction) - mine - bearing
            comes = abs(float(np.pi - (np.pi - relative) % (2 * np.pi))) < np.pi / 4
            if comes and abs(self.ways.turn(item, self._junction)) < np.pi / 5:
                found.append(item)
        if not found:
            raise UnsolvableError(f"nobody comes {self.conflict.actor.comes} at '{self._junction}'")
        return tuple(sorted(found, key=lambda item: item.from_lane))

    def _through(self) -> Placed:
        comes = self.conflict.actor.comes
        bearing = {"from_left": -np.pi / 2, "from_right": np.pi / 2}.get(comes, np.pi)
        movement = self._straight_from(bearing)[0]
        if comes == "oncoming_turning":
            movement = next(
                item
                for item in self.ways.movements[self._junction]
                if item.from_street == movement.from_street
                and self.ways.turn(item, self._junction) > np.pi / 5
            )
        way = self.ways.route((movement.from_street, movement.to_street), movement.from_lane)
        station = self.way.crossing(way)
        if station is None:
            raise UnsolvableError("the ways of ego and actor do not meet")
        line = way.stretches[0].ends_m
        start = BEFORE_LINE_M + self._body[1].length_m / 2
        room = way.nearest(self.way.at(station)) - (line - start)
        lane = movement.from_lane
        return Placed(
            station,
            room,
            route=(movement.from_street, movement.to_street),
            lane=lane,
            start_m=start,
        )

    def _edge_path(self, movement: Movement, aside_m: float) -> NDArray[np.float64]:
        """Along the right edge of the roadway, straight through the junction."""
        way = self.ways.route((movement.from_street, movement.to_street), movement.from_lane)
        before, after = way.stretches
        run = min(ALONGSIDE_M, before.ends_m - before.begins_m - 3.0)
        far = min(ALONGSIDE_M, after.ends_m - after.begins_m - 3.0)
        places = [(before.ends_m - run, before), (before.ends_m, before)]
        places += [(after.begins_m, after), (after.begins_m + far, after)]
        return np.array([way.at(station, _edge_line(item) - aside_m) for station, item in places])

    def _oncoming_edge(self) -> Placed:
        return self._along_edge(self._straight_from(np.pi)[-1])

    def _alongside(self) -> Placed:
        return self._along_edge(self._straight_from(0.0)[-1], BESIDE_EGO_M)

    def _along_edge(self, movement: Movement, aside_m: float = 0.0) -> Placed:
        path = self._edge_path(movement, aside_m)
        way = Way(path, ())
        station = self.way.crossing(way)
        if station is None:
            raise UnsolvableError("the ways of ego and actor do not meet")
        return Placed(station, way.nearest(self.way.at(station)), path=path)


def _outer_edge(stretch: Stretch, *, right: bool, to_median: bool = True) -> float:
    """Offset from the lane's centre to the outer edge of the lanes on a side, or to the median."""
    own = stretch.bands(right=True)
    if right:
        return stretch.lateral([b for b in own if b.kind is StripKind.LANE][-1].outer_t)
    if to_median and any(band.kind is StripKind.MEDIAN for band in own):
        return stretch.lateral(next(b for b in own if b.kind is StripKind.LANE).inner_t)
    other = [b for b in stretch.bands(right=False) if b.kind is StripKind.LANE]
    return stretch.lateral(other[-1].outer_t) if other else stretch.lateral(0.0)


def _edge_line(stretch: Stretch) -> float:
    """Where one rides at the edge: in the middle of the shoulder or parking lane, else beside."""
    bands = stretch.bands(right=True)
    last = max(index for index, band in enumerate(bands) if band.kind is StripKind.LANE)
    beside = bands[last + 1] if last + 1 < len(bands) else None
    if beside and beside.kind in (StripKind.SHOULDER, StripKind.PARKING) and beside.width_m > 1:
        return stretch.lateral(beside.centre_t)
    return stretch.lateral(bands[last].outer_t) - 0.25


def _point(place: NDArray[np.float64]) -> tuple[float, float]:
    return round(float(place[0]), 3), round(float(place[1]), 3)

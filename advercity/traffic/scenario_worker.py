"""The child process that runs and records a SUMO scenario of another author.

    python -m advercity.traffic.scenario_worker PARENT OUTPUT FROM_S TO_S OPTIONS...

PARENT is the id of the starting process, OUTPUT the JSON file to write. SUMO's options come from
`advercity.recordings.sumo_scenario`, which lets no others pass.
"""

import json
import sys
from pathlib import Path
from typing import Any

import libsumo

from advercity.errors import InputError
from advercity.processes import end_with_parent
from advercity.traffic.simulation import ERROR_MARK, EXIT_BAD_INPUT

MAX_SAMPLES = 4_000_000
"""Maximum number of places of all road users: an hour of a hundred at 10 Hz."""
FIXED_OPTIONS = ["--no-step-log", "true", "--no-warnings", "true", "--xml-validation", "never"]


def record(options: list[str], from_s: float, to_s: float) -> dict[str, Any]:
    """Run SUMO from its beginning and record from `from_s` to `to_s`.

    Returns:
        `vehicles` and `people`: by id, rows of time, east, north and SUMO's angle; `kinds`: class,
        length, width and height of vehicles by id; `lights`: by id, times and states, as they
        change.

    Raises:
        InputError: SUMO cannot run the scenario, or the recording becomes too large.
    """
    try:
        libsumo.start(["sumo", *options, *FIXED_OPTIONS])
        try:
            return _record(from_s, to_s)
        finally:
            libsumo.close()
    except (libsumo.TraCIException, libsumo.FatalTraCIError) as error:
        raise InputError(f"SUMO cannot run it: {error}") from None


def _record(from_s: float, to_s: float) -> dict[str, Any]:
    vehicles: dict[str, list[tuple[float, ...]]] = {}
    people: dict[str, list[tuple[float, ...]]] = {}
    kinds: dict[str, tuple[str, float, float, float]] = {}
    lights: dict[str, list[tuple[float, str]]] = {}
    count, query = 0, libsumo.vehicle
    while (time_s := libsumo.simulation.getTime()) <= to_s:
        if time_s >= from_s:
            names = query.getIDList()
            for name in names:
                if name not in kinds:
                    size = query.getLength(name), query.getWidth(name), query.getHeight(name)
                    kinds[name] = (query.getVehicleClass(name), *size)
                row = (time_s, *query.getPosition(name), query.getAngle(name))
                vehicles.setdefault(name, []).append(row)
            for name in libsumo.person.getIDList():
                if not libsumo.person.getVehicle(name):
                    place = libsumo.person.getPosition(name)
                    row = (time_s, *place, libsumo.person.getAngle(name))
                    people.setdefault(name, []).append(row)
                    count += 1
            for light in libsumo.trafficlight.getIDList():
                state = libsumo.trafficlight.getRedYellowGreenState(light)
                known = lights.setdefault(light, [])
                if not known or known[-1][1] != state:
                    known.append((time_s, state))
            count += len(names)
            if count > MAX_SAMPLES:
                raise InputError(
                    f"has more than {MAX_SAMPLES} places of road users by {time_s:g} s; take a"
                    " shorter time with `from` and `to`"
                )
        if libsumo.simulation.getMinExpectedNumber() == 0:
            break
        libsumo.simulationStep()
    return {"vehicles": vehicles, "people": people, "kinds": kinds, "lights": lights}


def main(output: str, from_s: str, to_s: str, *options: str) -> None:
    """Record a scenario and write the recording."""
    found = record(list(options), float(from_s), float(to_s))
    Path(output).write_text(json.dumps(found), encoding="utf-8")


if __name__ == "__main__":
    try:
        end_with_parent(int(sys.argv[1]))
        main(*sys.argv[2:])
    except InputError as error:
        sys.stderr.write(f"{ERROR_MARK}{error}")
        sys.exit(EXIT_BAD_INPUT)

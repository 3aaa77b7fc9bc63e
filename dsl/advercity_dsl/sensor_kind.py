"""A kind of sensor: one record with all parts of the kind.

The module of such a record imports only from here and from `base`, `mount`, `sampling` and `units`:
rigs load the record before the rest of the language.
"""

from dataclasses import dataclass
from typing import Literal

from advercity_dsl.sampling import Sampled


@dataclass(frozen=True)
class SensorKind:
    """A kind of sensor for rigs.

    Attributes:
        name: Key in a rig; part of the names of files and of random streams.
        title: Singular for people: `thermal camera`.
        model: Model of the key's value, with `mounts` or `mount` unless it is placed as `body`.
        placing: How sensors follow a roadside unit: `aimed` ones turn and tilt with it, `level`
            ones are level and face east, `body` ones have no place and time of their own.
        files: `module:attribute` of the `SensorFiles` of `advercity.dataset.sensor_files` for its
            measurements, loaded at the first use.
        driver: Names its `SensorDriver` of `advercity.sensors.stage`.
        show: Names a function of `advercity.viewer.shown` to list the parts of a measurement in
            viewers; empty if they show none.
        not_on_units: Why no roadside unit has one; empty if it may.
    """

    name: str
    title: str
    model: type[Sampled]
    placing: Literal["aimed", "level", "body"]
    files: str
    driver: str
    show: str = ""
    not_on_units: str = ""

    @property
    def has_place(self) -> bool:
        """Whether each of its sensors has a mount, and measures at most once a frame."""
        return self.placing != "body"

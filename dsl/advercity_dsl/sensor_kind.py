"""A kind of sensor: one record with all that the kind brings along.

The module of such a record imports only from here and from `base`, `mount`, `sampling` and `units`:
rigs ask for the record while all else of the language is still being loaded.
"""

from dataclasses import dataclass
from functools import cache
from importlib import import_module
from typing import Any, Literal

from advercity_dsl.sampling import Sampled


@dataclass(frozen=True)
class SensorKind:
    """A kind of sensor that rigs may have.

    Attributes:
        name: Key in a rig; part of the names of files and of random streams.
        title: Singular for people: `thermal camera`.
        model: Model of the key's value, with `mounts` or `mount` unless it is placed as `body`.
        placing: How sensors follow a roadside unit: `aimed` ones turn and tilt with it, `level`
            ones are level and face east, `body` ones have no place and time of their own.
        files: Names, as `module:attribute`, the `SensorFiles` of `advercity.dataset.sensor_files`
            that keep its measurements; it is loaded when it is used.
        driver: Names a `SensorDriver` of `advercity.sensors.stage`, which measures.
        show: Names a function of `advercity.viewer.shown` that lists what viewers show of a
            measurement; empty if they show none.
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


@cache
def load_named(reference: str) -> Any:
    """Load what `module:attribute` names."""
    module, _, attribute = reference.partition(":")
    return getattr(import_module(module), attribute)

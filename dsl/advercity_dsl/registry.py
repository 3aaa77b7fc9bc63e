"""Records that other distributions register: kinds of sensors, parts of the weather, formats."""

from collections.abc import Callable, Mapping, Sequence
from functools import cache
from importlib import import_module
from importlib.metadata import entry_points
from itertools import groupby
from operator import itemgetter
from typing import Any, Generic, NamedTuple, Protocol, TypeVar

from pydantic import BaseModel, create_model


class _Record(Protocol):
    @property
    def name(self) -> str: ...


_R = TypeVar("_R", bound=_Record)


class Registered(NamedTuple, Generic[_R]):
    """Records of one sort in an installation.

    Attributes:
        found: Records by name: of advercity, then of others by name.
        broken: Reasons why other registered records cannot be used, by name.
        distributions: Names of the distributions that register records, by name of the record.
    """

    found: Mapping[str, _R]
    broken: Mapping[str, str]
    distributions: Mapping[str, str]


@cache
def load_named(reference: str) -> Any:
    """Load the attribute of a module, `module:attribute`."""
    module, _, attribute = reference.partition(":")
    return getattr(import_module(module), attribute)


def load_registered(
    group: str,
    core: Mapping[str, _R],
    record_type: type[_R],
    check: Callable[[_R, Mapping[str, _R]], None] = lambda record, found: None,
) -> Registered[_R]:
    """Load the records of an installation.

    Args:
        group: Group of their entry points, which have the records' names.
        core: Records of advercity, by name.
        record_type: Type of the records.
        check: Raises a ValueError if a record does not go with those found before.
    """
    found, broken = dict(core), dict[str, str]()
    # By name: the order of installation must not matter. A distribution on two paths is listed
    # twice.
    entries = entry_points(group=group)
    distributions = {entry.name: entry.dist.name if entry.dist else "" for entry in entries}
    claimed = sorted({(entry.name, entry.value) for entry in entries})

    def load(name: str, values: Sequence[str]) -> _R:
        claims = [*(["advercity"] if name in core else []), *values]
        if len(claims) > 1:
            raise ValueError(f"the name is claimed by {', '.join(claims)}; uninstall all but one")
        record = load_named(values[0])
        if not isinstance(record, record_type) or record.name != name:
            raise ValueError(f"{values[0]} is no {record_type.__name__} with the name '{name}'")
        check(record, found)
        return record

    for name, claims in groupby(claimed, key=itemgetter(0)):
        try:
            found[name] = load(name, [value for _, value in claims])
        except Exception as error:  # modules of others may raise anything
            broken[name] = str(error)
    return Registered(found, broken, distributions)


def check_model(name: str, model: type[BaseModel], base: type[BaseModel]) -> None:
    """Raise a ValueError if the model of a record is not derived from a class."""
    if not issubclass(model, base):
        raise ValueError(f"{name} has a model that is not derived from {base.__name__}")


def add_fields(base: type[BaseModel], fields: Mapping[str, Any]) -> Any:
    """Add fields of other distributions to a model; without any, it is the class as it is."""
    if not fields:
        return base
    return create_model(
        base.__name__, __base__=base, __doc__=base.__doc__, __module__=base.__module__, **fields
    )

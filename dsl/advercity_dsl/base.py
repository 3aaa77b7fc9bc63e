"""Base classes of all models, ids, errors of combinations, and suggestions for misspelt names."""

import difflib
from collections.abc import Iterable
from functools import cache
from typing import Annotated, Any, TypeVar

from pydantic import (
    BaseModel,
    ConfigDict,
    Field,
    SerializerFunctionWrapHandler,
    model_serializer,
)
from pydantic.types import StringConstraints

MAX_ID_LENGTH = 64
ID_PATTERN = r"^[a-z][a-z0-9_]{0,63}$"
ID_HINT = f"lower-case letters, digits and _, at most {MAX_ID_LENGTH}, starting with a letter"
Id = Annotated[str, StringConstraints(pattern=ID_PATTERN)]
"""A stable lower-case name, safe as a file name on every system."""
Digest = Annotated[str, StringConstraints(pattern=r"^[0-9a-f]{64}$")]
"""A SHA-256 in hexadecimal."""
_Item = TypeVar("_Item")
Items = Annotated[tuple[_Item, ...], Field(max_length=10_000)]
"""A list; no declaration needs more than ten thousand items."""
ByName = Annotated[dict[Id, _Item], Field(max_length=1000)]
"""Things by their names."""
ValuePath = tuple[str | int, ...]
"""Path of a value in nested data: keys of mappings and indices of lists."""


class Model(BaseModel):
    """Frozen record without unknown keys and infinite numbers."""

    # JSON has no infinite numbers; a misspelt key must not be ignored.
    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class InvalidCombination(ValueError):
    """Values valid one by one, but in contradiction with each other.

    Attributes:
        value_path: Path of the value to change, relative to the raising model.
        message: The contradiction.
        hint: How to correct it.
        other_path: Path of the conflicting value, shown if the first is a default.
    """

    def __init__(
        self,
        value_path: ValuePath,
        message: str,
        hint: str,
        *,
        other_path: ValuePath = (),
    ) -> None:
        super().__init__(f"{'.'.join(map(str, value_path))}: {message}; {hint}")
        self.value_path = value_path
        self.message = message
        self.hint = hint
        self.other_path = other_path


class Declaration(Model):
    """Fields of every YAML document in addition to its `kind`."""

    id: Id
    """Name by which others refer to it; part of the ids of scenarios."""
    title: str = ""
    """Short description."""
    source: str = ""
    """Source of the figures."""
    assumption: str = ""
    """Figures assumed rather than measured, with the reason for the choice."""


def check_all_or_list(value: object, *, things: str, hint: str) -> object:
    """Refuse a text other than `all` in place of a list; InvalidCombination with the way out."""
    if isinstance(value, str) and value != "all":
        message = f"'{value[:40]}' is neither `all` nor a list of {things}"
        raise InvalidCombination((), message, hint)
    return value


def find_all_or_list_tag(value: object) -> str:
    """Return the tag of a value, `all` or `list`, for a `Discriminator`."""
    return "list" if isinstance(value, list | tuple) else "all"


def is_none(value: object) -> bool:
    """Return whether a field is None, for `exclude_if`, which omits it from the spec's JSON."""
    return value is None


def is_empty(value: object) -> bool:
    """Return whether a field is None, zero or empty, for `exclude_if`."""
    return not value


class CompactModel(Model):
    """A record whose default values are omitted from JSON, since a spec holds dozens of them."""

    # A serializer per class, since pydantic's exclude_defaults applies to a whole dump.
    @model_serializer(mode="wrap")
    def _serialize_without_defaults(
        self, serialise: SerializerFunctionWrapHandler
    ) -> dict[str, Any]:
        defaults, fields = _get_field_defaults(type(self)), vars(self)
        return {
            name: value
            for name, value in serialise(self).items()
            if name not in defaults or fields[name] != defaults[name]
        }


@cache
def _get_field_defaults(model: type[Model]) -> dict[str, Any]:
    """Map each optional field of a model to its default."""
    fields = model.model_fields.items()
    return {
        name: field.get_default(call_default_factory=True)
        for name, field in fields
        if not field.is_required()
    }


MAX_LISTED_NAMES = 20
MIN_SIMILARITY = 0.5


def suggest_name(name: str, valid: Iterable[str]) -> str:
    """Return a hint with the most similar valid name, else with all valid names."""
    names = sorted(valid)

    def rate(other: str) -> tuple[float, bool]:
        """Rate the similarity; among equally similar names, one with the same first letter wins."""
        similarity = difflib.SequenceMatcher(None, other, name).ratio()
        return similarity, other[:1] == name[:1]

    close = max(names, key=rate, default=None)
    # Below difflib's usual 0.6: a doubtful suggestion says more than a list of all names.
    if close is not None and rate(close)[0] >= MIN_SIMILARITY:
        return f"did you mean '{close}'?"
    more = ", ..." if len(names) > MAX_LISTED_NAMES else ""
    return f"available: {', '.join(names[:MAX_LISTED_NAMES])}{more}" if names else "none available"

"""What every model shares: frozen, closed to unknown keys, ids and quantities with units.

Hints that name what somebody may have meant.
"""

import difflib
from collections.abc import Iterable
from functools import cache
from typing import Annotated, Any

from pydantic import (
    BaseModel,
    ConfigDict,
    SerializerFunctionWrapHandler,
    model_serializer,
)
from pydantic.types import StringConstraints

Id = Annotated[str, StringConstraints(pattern=r"^[a-z][a-z0-9_]{0,63}$")]
"""A stable lower-case name; safe as a file name."""
Digest = Annotated[str, StringConstraints(pattern=r"^[0-9a-f]{64}$")]
"""A SHA-256."""


class Model(BaseModel):
    """Frozen record; an unknown key is an error, and so is a number without end."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class InvalidCombination(ValueError):
    """Values that are fine alone and do not go together.

    Attributes:
        value_path: Path of the value to change, from the model that found it.
        message: What is wrong.
        hint: The way out.
        other_path: Path of the other value, to be shown where the first is a default.
    """

    def __init__(
        self,
        value_path: tuple[str | int, ...],
        message: str,
        hint: str,
        *,
        other_path: tuple[str | int, ...] = (),
    ) -> None:
        super().__init__(f"{'.'.join(map(str, value_path))}: {message}; {hint}")
        self.value_path = value_path
        self.message = message
        self.hint = hint
        self.other_path = other_path


class Declaration(Model):
    """What every YAML document has besides its `kind`."""

    id: Id
    """Its name, by which others refer to it; part of the ids of scenarios."""
    title: str = ""
    """What it is, in a few words."""
    source: str = ""
    """Where the figures come from."""
    assumption: str = ""
    """Which figures nobody measured, and why they are what they are."""


def is_none(value: object) -> bool:
    """For `exclude_if`: a field that says nothing is left out of a spec's JSON."""
    return value is None


def is_empty(value: object) -> bool:
    """The same for what is none, zero, or holds nothing."""
    return not value


class CompactModel(Model):
    """A record that a spec holds dozens of: what goes without saying is left out of its JSON."""

    @model_serializer(mode="wrap")
    def _serialize_without_defaults(
        self, serialise: SerializerFunctionWrapHandler
    ) -> dict[str, Any]:
        defaults = _get_field_defaults(type(self))
        return {
            name: value
            for name, value in serialise(self).items()
            if name not in defaults or getattr(self, name) != defaults[name]
        }


@cache
def _get_field_defaults(model: type[Model]) -> dict[str, Any]:
    """What goes without saying, by field."""
    fields = model.model_fields.items()
    return {
        name: field.get_default(call_default_factory=True)
        for name, field in fields
        if not field.is_required()
    }


MAX_LISTED_NAMES = 20


def suggest_name(name: str, valid: Iterable[str]) -> str:
    """A hint that names the nearest valid name, else all of them."""
    names = sorted(valid)
    close = difflib.get_close_matches(name, names, n=1, cutoff=0.5)
    if close:
        return f"did you mean '{close[0]}'?"
    more = ", ..." if len(names) > MAX_LISTED_NAMES else ""
    return f"there are: {', '.join(names[:MAX_LISTED_NAMES])}{more}" if names else "there are none"

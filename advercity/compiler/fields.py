"""What a model says about the field at a path: its unit, range, and the names beside it."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, get_args, get_origin

from advercity_dsl import Model
from advercity_dsl.base import Reason, Unit
from annotated_types import Ge, Gt, Le, Lt
from pydantic.fields import FieldInfo

from advercity.compiler.source import Where


@dataclass(frozen=True)
class Facts:
    """What is known of a number: its unit and the range it lies in, and why."""

    unit: Unit | None = None
    low: float | None = None
    high: float | None = None
    open_low: bool = False
    open_high: bool = False
    reason: str = ""
    whole: bool = False

    @property
    def range(self) -> str:
        """`0 to 150 mm/h`, `above 0 m`; empty where any number will do."""
        name = self.unit.name if self.unit and self.unit.name != "1" else ""
        if self.low is not None and self.high is not None:
            low = f"above {self.low:g}" if self.open_low else f"{self.low:g}"
            high = f"below {self.high:g}" if self.open_high else f"{self.high:g}"
            words = f"{low} to {high}" if not self.open_high else f"{low} and {high}"
        elif self.low is not None:
            words = f"above {self.low:g}" if self.open_low else f"{self.low:g} or more"
        elif self.high is not None:
            words = f"below {self.high:g}" if self.open_high else f"at most {self.high:g}"
        else:
            return ""
        return f"{words} {name}".rstrip()


def annotations_at(model: type[Model], where: Where) -> list[Any]:
    """What may stand at a path: classes, unions, `Annotated` forms; tags of unions pass."""
    candidates: list[Any] = [model]
    for part in where:
        inner: list[Any] = []
        for candidate in candidates:
            inner += _step(candidate, part)
        candidates = inner or candidates
    return candidates


def _step(annotation: Any, part: str | int) -> list[Any]:
    if isinstance(annotation, type) and issubclass(annotation, Model):
        for name, field in annotation.model_fields.items():
            if part == (field.alias or name):
                return [field]
        tagged = annotation.__name__ == part or _tag(annotation) == part
        return [annotation] if tagged else []
    if isinstance(annotation, FieldInfo):
        return _step(annotation.annotation, part)
    if annotation is None or isinstance(annotation, str):
        return []
    origin, arguments = get_origin(annotation), get_args(annotation)
    if origin is tuple and isinstance(part, int):
        repeated = len(arguments) == 2 and arguments[1] is Ellipsis
        return [arguments[0]] if repeated else [arguments[min(part, len(arguments) - 1)]]
    if origin is dict:
        return [arguments[1]]
    return [found for argument in arguments for found in _step(argument, part)]


def models_at(model: type[Model], where: Where) -> list[type[Model]]:
    """Every model that may stand at a path."""
    return [found for item in annotations_at(model, where) for found in _models_in(item)]


def field_names(model: type[Model], where: Where) -> list[str]:
    """Names of the fields that a value at a path may have, as they are written."""
    models = models_at(model, where)
    return sorted(
        {field.alias or name for item in models for name, field in item.model_fields.items()}
    )


def facts_at(model: type[Model], where: Where) -> Facts | None:
    """Unit and range of the number at a path; None if no number stands there."""
    known: dict[str, Any] = {}
    for item in annotations_at(model, where):
        for mark in _marks(item):
            match mark:
                case Unit():
                    known["unit"] = mark
                case Reason(text):
                    known["reason"] = text
                case Ge(ge):
                    known |= {"low": ge, "open_low": False}
                case Gt(gt):
                    known |= {"low": gt, "open_low": True}
                case Le(le):
                    known |= {"high": le, "open_high": False}
                case Lt(lt):
                    known |= {"high": lt, "open_high": True}
                case type() if mark in (int, float):
                    known["whole"] = mark is int
                case _:
                    pass
    return Facts(**known) if "whole" in known else None


def _marks(annotation: Any) -> Iterator[Any]:
    """The types and metadata of an annotation, from the inside out; not those of its items."""
    if isinstance(annotation, FieldInfo):
        yield from _marks(annotation.annotation)
        for mark in annotation.metadata:
            yield from _marks(mark)
    elif hasattr(annotation, "__metadata__"):
        yield from _marks(annotation.__origin__)
        for mark in annotation.__metadata__:
            yield from _marks(mark)
    elif get_origin(annotation) in (tuple, dict):
        return
    elif get_args(annotation):
        for argument in get_args(annotation):
            yield from _marks(argument)
    else:
        yield annotation


def _models_in(annotation: Any) -> list[type[Model]]:
    if isinstance(annotation, FieldInfo):
        return _models_in(annotation.annotation)
    if isinstance(annotation, type) and issubclass(annotation, Model):
        return [annotation]
    if get_origin(annotation) in (tuple, dict):
        return []
    parts: tuple[Any, ...] = get_args(annotation)
    return [found for part in parts for found in _models_in(part)]


def _tag(model: type[Model]) -> Any:
    kind = model.model_fields.get("kind")
    return kind.default if kind else None

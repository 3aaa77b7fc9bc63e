"""What a model says about the field at a path: its unit, range, and the names beside it.

What models say about their fields: the texts below them in the source.
"""

import ast
import inspect
import textwrap
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, get_args, get_origin

from advercity_dsl import Model
from advercity_dsl.units import RangeReason, Unit
from annotated_types import Ge, Gt, Le, Lt
from pydantic.fields import FieldInfo

from advercity.compiler.source import ValuePath


@dataclass(frozen=True)
class NumberConstraints:
    """What is known of a number: its unit and the range it lies in, and why."""

    unit: Unit | None = None
    low: float | None = None
    high: float | None = None
    open_low: bool = False
    open_high: bool = False
    reason: str = ""
    whole: bool = False

    @property
    def range_text(self) -> str:
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


def find_annotations(model: type[Model], where: ValuePath) -> list[Any]:
    """What may stand at a path: classes, unions, `Annotated` forms; tags of unions pass."""
    candidates: list[Any] = [model]
    for part in where:
        inner: list[Any] = []
        for candidate in candidates:
            inner += _descend(candidate, part)
        candidates = inner or candidates
    return candidates


def _descend(annotation: Any, part: str | int) -> list[Any]:
    if isinstance(annotation, type) and issubclass(annotation, Model):
        for name, field in annotation.model_fields.items():
            if part == (field.alias or name):
                return [field]
        tagged = annotation.__name__ == part or _find_kind_tag(annotation) == part
        return [annotation] if tagged else []
    if isinstance(annotation, FieldInfo):
        return _descend(annotation.annotation, part)
    if annotation is None or isinstance(annotation, str):
        return []
    origin, arguments = get_origin(annotation), get_args(annotation)
    if origin is tuple and isinstance(part, int):
        repeated = len(arguments) == 2 and arguments[1] is Ellipsis
        return [arguments[0]] if repeated else [arguments[min(part, len(arguments) - 1)]]
    if origin is dict:
        return [arguments[1]]
    return [found for argument in arguments for found in _descend(argument, part)]


def find_models(model: type[Model], where: ValuePath) -> list[type[Model]]:
    """Every model that may stand at a path."""
    return [found for item in find_annotations(model, where) for found in _find_direct_models(item)]


def find_field_names(model: type[Model], where: ValuePath) -> list[str]:
    """Names of the fields that a value at a path may have, as they are written."""
    models = find_models(model, where)
    return sorted(
        {field.alias or name for item in models for name, field in item.model_fields.items()}
    )


def find_number_constraints(model: type[Model], where: ValuePath) -> NumberConstraints | None:
    """Unit and range of the number at a path; None if no number stands there."""
    known: dict[str, Any] = {}
    for item in find_annotations(model, where):
        for mark in _iterate_metadata(item):
            match mark:
                case Unit():
                    known["unit"] = mark
                case RangeReason(text):
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
    return NumberConstraints(**known) if "whole" in known else None


def _iterate_metadata(annotation: Any) -> Iterator[Any]:
    """The types and metadata of an annotation, from the inside out; not those of its items."""
    if isinstance(annotation, FieldInfo):
        yield from _iterate_metadata(annotation.annotation)
        for mark in annotation.metadata:
            yield from _iterate_metadata(mark)
    elif hasattr(annotation, "__metadata__"):
        yield from _iterate_metadata(annotation.__origin__)
        for mark in annotation.__metadata__:
            yield from _iterate_metadata(mark)
    elif get_origin(annotation) in (tuple, dict):
        return
    elif get_args(annotation):
        for argument in get_args(annotation):
            yield from _iterate_metadata(argument)
    else:
        yield annotation


def _find_direct_models(annotation: Any) -> list[type[Model]]:
    if isinstance(annotation, FieldInfo):
        return _find_direct_models(annotation.annotation)
    if isinstance(annotation, type) and issubclass(annotation, Model):
        return [annotation]
    if get_origin(annotation) in (tuple, dict):
        return []
    parts: tuple[Any, ...] = get_args(annotation)
    return [found for part in parts for found in _find_direct_models(part)]


def _find_kind_tag(model: type[Model]) -> Any:
    kind = model.model_fields.get("kind")
    return kind.default if kind else None


def collect_field_docs(model: type[Model]) -> dict[str, dict[str, str]]:
    """Texts of the fields, by written name, of a model and of all that it holds, by class name."""
    found: dict[str, dict[str, str]] = {}
    _collect_field_docs(model, found)
    return found


def _collect_field_docs(model: type[Model], found: dict[str, dict[str, str]]) -> None:
    if model.__name__ in found:
        return
    texts: dict[str, str] = {}
    for base in reversed(model.__mro__):
        if issubclass(base, Model) and base is not Model:
            texts |= _parse_field_docs(base)
    fields = model.model_fields.items()
    found[model.__name__] = {
        field.alias or name: texts[name] for name, field in fields if name in texts
    }
    for _, field in fields:
        for inner in find_nested_models(field.annotation):
            _collect_field_docs(inner, found)


def _parse_field_docs(model: type[Model]) -> dict[str, str]:
    """Texts below the fields of one class."""
    (tree,) = ast.parse(textwrap.dedent(inspect.getsource(model))).body
    body = tree.body if isinstance(tree, ast.ClassDef) else []
    texts: dict[str, str] = {}
    for line, below in pairwise(body):
        match line, below:
            case ast.AnnAssign(target=ast.Name(name)), ast.Expr(value=ast.Constant(str(text))):
                texts[name] = inspect.cleandoc(text)
            case _:
                pass
    return texts


def find_nested_models(annotation: Any) -> list[type[Model]]:
    """Every model in an annotation, those of lists and mappings too."""
    if isinstance(annotation, type) and issubclass(annotation, Model):
        return [annotation]
    return [found for part in get_args(annotation) for found in find_nested_models(part)]

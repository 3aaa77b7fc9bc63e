"""Introspection of models: constraints, field names and documentation of the field at a path."""

import ast
import inspect
import textwrap
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, Literal, get_args, get_origin

from advercity_dsl import Model
from advercity_dsl.base import ValuePath
from advercity_dsl.units import RangeReason, Unit
from annotated_types import Ge, Gt, Le, Lt
from pydantic.fields import FieldInfo


@dataclass(frozen=True)
class NumberConstraints:
    """Unit and range of a number, and the reason for the range."""

    unit: Unit | None = None
    low: float | None = None
    high: float | None = None
    open_low: bool = False
    open_high: bool = False
    reason: str = ""
    whole: bool = False

    @property
    def unit_name(self) -> str:
        """Name of the unit; empty for plain numbers."""
        return self.unit.name if self.unit and self.unit.name != "1" else ""

    @property
    def range_text(self) -> str:
        """`0 to 150 mm/h`, `above 0 m`; empty without a range."""
        if self.low is not None and self.high is not None:
            high = f"{self.high:.12g}"
            low = f"above {self.low:.12g}" if self.open_low else f"{self.low:.12g}"
            text = f"{low} and below {high}" if self.open_high else f"{low} to {high}"
        elif self.low is not None:
            text = f"above {self.low:g}" if self.open_low else f"{self.low:g} or more"
        elif self.high is not None:
            text = f"below {self.high:g}" if self.open_high else f"at most {self.high:g}"
        else:
            return ""
        return f"{text} {self.unit_name}".rstrip()

    def parse(self, value: Any) -> Any:
        """Convert text with a unit to a number; return any other value unchanged.

        Raises:
            ValueError: The text is not a quantity of this unit.
        """
        return self.unit.parse(value) if self.unit else value


def find_annotations(model: type[Model], value_path: ValuePath) -> list[Any]:
    """Return the annotations of the value at a path: classes, unions, `Annotated` forms.

    Parts of the path may be tags of unions, as in pydantic's error locations.
    """
    candidates: list[Any] = [model]
    for part in value_path:
        inner = [found for candidate in candidates for found in _descend(candidate, part)]
        # A tag is not a level of the annotation it selects: stay at the same level.
        candidates = inner or candidates
    return candidates


def _descend(annotation: Any, part: str | int) -> list[Any]:
    if isinstance(annotation, type) and issubclass(annotation, Model):
        for name, field in annotation.model_fields.items():
            # Aliases are YAML keys reserved in Python, such as `from`.
            if part == (field.alias or name):
                return [field]
        is_tagged = part in (annotation.__name__, *find_tags(annotation))
        return [annotation] if is_tagged else []
    if isinstance(annotation, FieldInfo):
        return _descend(annotation.annotation, part)
    if annotation is None or isinstance(annotation, str):
        return []
    origin, arguments = get_origin(annotation), get_args(annotation)
    if origin is tuple and isinstance(part, int):
        is_repeated = len(arguments) == 2 and arguments[1] is Ellipsis
        return [arguments[0]] if is_repeated else [arguments[min(part, len(arguments) - 1)]]
    if origin is dict:
        return [arguments[1]]
    return [found for argument in arguments for found in _descend(argument, part)]


def find_tags(model: type[Model]) -> list[Any]:
    """Find the values of single-valued fields, by which unions select the model."""
    annotations = [field.annotation for field in model.model_fields.values()]
    values = [get_args(item) for item in annotations if get_origin(item) is Literal]
    return [found[0] for found in values if len(found) == 1]


def find_models(model: type[Model], value_path: ValuePath) -> list[type[Model]]:
    """Return every valid model at a path."""
    return [
        found
        for annotation in find_annotations(model, value_path)
        for found in find_nested_models(annotation, into_items=False)
    ]


def find_nested_models(annotation: Any, *, into_items: bool = True) -> list[type[Model]]:
    """Return every model in an annotation, by default also in list and mapping items."""
    if isinstance(annotation, FieldInfo):
        annotation = annotation.annotation
    if isinstance(annotation, type) and issubclass(annotation, Model):
        return [annotation]
    if not into_items and get_origin(annotation) in (tuple, dict):
        return []
    return [
        found
        for part in get_args(annotation)
        for found in find_nested_models(part, into_items=into_items)
    ]


def find_field_names(model: type[Model], value_path: ValuePath) -> list[str]:
    """Return the names, as written in YAML, of the fields of a value at a path."""
    models = find_models(model, value_path)
    return sorted(
        {field.alias or name for item in models for name, field in item.model_fields.items()}
    )


def find_number_constraints(model: type[Model], value_path: ValuePath) -> NumberConstraints | None:
    """Return unit and range of the number at a path; None if the value is not a number."""
    known: dict[str, Any] = {}
    reason = RangeReason("")
    for annotation in find_annotations(model, value_path):
        for item in _iterate_metadata(annotation):
            match item:
                case Unit():
                    known["unit"] = item
                case RangeReason():
                    reason = item
                case Ge(bound):
                    known |= {"low": bound, "open_low": False}
                case Gt(bound):
                    known |= {"low": bound, "open_low": True}
                case Le(bound):
                    known |= {"high": bound, "open_high": False}
                case Lt(bound):
                    known |= {"high": bound, "open_high": True}
                case type() if item in (int, float):
                    known["whole"] = item is int
                case _:
                    pass
    if reason.upper in (None, known.get("high")):
        known["reason"] = reason.text
    return NumberConstraints(**known) if "whole" in known else None


def _iterate_metadata(annotation: Any) -> Iterator[Any]:
    """Yield types and metadata of an annotation from the inside out, without its items'."""
    if isinstance(annotation, FieldInfo):
        yield from _iterate_metadata(annotation.annotation)
        for item in annotation.metadata:
            yield from _iterate_metadata(item)
    elif hasattr(annotation, "__metadata__"):
        yield from _iterate_metadata(annotation.__origin__)
        for item in annotation.__metadata__:
            yield from _iterate_metadata(item)
    elif get_origin(annotation) in (tuple, dict):
        return
    elif get_args(annotation):
        for argument in get_args(annotation):
            yield from _iterate_metadata(argument)
    else:
        yield annotation


def collect_field_docs(model: type[Model]) -> dict[str, dict[str, str]]:
    """Return docstrings of fields by class name and YAML name, of a model and all nested ones."""
    docs: dict[str, dict[str, str]] = {}
    pending = [model]
    while pending:
        current = pending.pop(0)
        if current.__name__ in docs:
            continue
        texts: dict[str, str] = {}
        # Base classes first: a class can describe an inherited field differently.
        for base in reversed(current.__mro__):
            if issubclass(base, Model) and base is not Model:
                texts |= _parse_field_docs(base)
        fields = current.model_fields.items()
        docs[current.__name__] = {
            field.alias or name: texts[name] for name, field in fields if name in texts
        }
        pending += [inner for _, field in fields for inner in find_nested_models(field)]
    return docs


def _parse_field_docs(model: type[Model]) -> dict[str, str]:
    """Return the strings below the fields in the source of one class."""
    # pydantic's use_attribute_docstrings would parse all sources at every import instead.
    (tree,) = ast.parse(textwrap.dedent(inspect.getsource(model))).body
    body = tree.body if isinstance(tree, ast.ClassDef) else []
    texts: dict[str, str] = {}
    for statement, below in pairwise(body):
        match statement, below:
            case ast.AnnAssign(target=ast.Name(name)), ast.Expr(value=ast.Constant(str(text))):
                texts[name] = inspect.cleandoc(text)
            case _:
                pass
    return texts

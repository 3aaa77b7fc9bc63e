"""From located data to models, with pydantic's errors put where the author can see them."""

from collections.abc import Iterator
from typing import Any, TypeVar, get_args

from advercity_dsl import Model
from pydantic import ValidationError

from advercity.compiler.problems import Problem, ProblemsError, nearest
from advercity.compiler.source import Document, Where

LONGEST_SHOWN = 60
ModelT = TypeVar("ModelT", bound=Model)


def validate(model: type[ModelT], document: Document, data: Any = None) -> ModelT:
    """`model` made of the document's data (or of `data`, e.g. with `extends` merged in)."""
    try:
        return model.model_validate(document.data if data is None else data)
    except ValidationError as error:
        raise ProblemsError(list(_problems(model, document, error))) from None


def _problems(model: type[Model], document: Document, error: ValidationError) -> Iterator[Problem]:
    details = error.errors(include_url=False)
    for detail in _of_best_alternative(document, details):
        loc: Where = detail["loc"]
        where = _in_document(document, loc)
        match detail["type"]:
            case "extra_forbidden":
                name = str(loc[-1])
                hint = nearest(name, _fields_at(model, loc[:-1]))
                yield document.problem(where, "no such field", hint=hint, key=True)
            case "missing":
                name = str(loc[-1])
                yield document.problem(where, f"the field '{name}' is missing")
            case "string_pattern_mismatch" if _is_id(detail):
                message = f"'{detail['input']}' is not an id"
                hint = "lower-case letters, digits and _, starting with a letter"
                yield document.problem(where, message, hint=hint)
            case _:
                message = detail["msg"].removeprefix("Value error, ")
                yield document.problem(where, f"{message[0].lower()}{message[1:]}{_got(detail)}")


def _is_id(detail: Any) -> bool:
    return detail["ctx"]["pattern"].startswith("^[a-z][a-z0-9_]{0,")


def _got(detail: Any) -> str:
    value = detail["input"]
    shown = isinstance(value, str | int | float | bool) and detail["type"] != "value_error"
    if not shown:
        return ""
    text = repr(value)
    return f" (found {text if len(text) <= LONGEST_SHOWN else text[:LONGEST_SHOWN] + '...'})"


def _in_document(document: Document, loc: Where) -> Where:
    """`loc` without the tags that pydantic puts in for the alternatives of a union."""
    where: Where = ()
    for part in loc:
        if (*where, part) in document.places:
            where = (*where, part)
    return where


def _of_best_alternative(document: Document, details: list[Any]) -> list[Any]:
    """Of a union's alternatives, only the complaints of the one that fits best."""
    by_value: dict[Where, dict[str, list[Any]]] = {}
    kept: list[Any] = []
    for detail in details:
        split = _union_split(document, detail["loc"])
        if split is None:
            kept.append(detail)
        else:
            by_value.setdefault(split[0], {}).setdefault(split[1], []).append(detail)
    for alternatives in by_value.values():
        kept += min(alternatives.values(), key=_misfit)
    return kept


def _misfit(complaints: list[Any]) -> tuple[int, int]:
    """How badly an alternative fits: unknown or missing fields weigh more than wrong values."""
    structural = sum(item["type"] in ("missing", "extra_forbidden") for item in complaints)
    return structural, len(complaints)


def _union_split(document: Document, loc: Where) -> tuple[Where, str] | None:
    """The value that a union is about and the alternative's name, if `loc` passes one."""
    where: Where = ()
    for part in loc[:-1] if len(loc) > 1 else loc:
        if (*where, part) in document.places:
            where = (*where, part)
        elif isinstance(part, str):
            return where, part
    return None


def _fields_at(model: type[Model], loc: Where) -> list[str]:
    """Names of the fields that a value at `loc` may have."""
    candidates: list[Any] = [model]
    for part in loc:
        inner: list[Any] = []
        for candidate in candidates:
            if isinstance(candidate, type) and issubclass(candidate, Model):
                if part in candidate.model_fields:
                    inner += _models_in(candidate.model_fields[str(part)].annotation)
                elif candidate.__name__ == part or _tag(candidate) == part:
                    inner.append(candidate)
        # An index or a key of a mapping leads to the same candidates.
        candidates = inner or candidates
    return sorted({name for candidate in candidates for name in candidate.model_fields})


def _tag(model: type[Model]) -> Any:
    kind = model.model_fields.get("kind")
    return kind.default if kind else None


def _models_in(annotation: Any) -> list[type[Model]]:
    if isinstance(annotation, type) and issubclass(annotation, Model):
        return [annotation]
    parts: tuple[Any, ...] = get_args(annotation)
    return [found for part in parts for found in _models_in(part)]

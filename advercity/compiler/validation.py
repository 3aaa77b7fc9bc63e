"""From located data to models, with pydantic's errors put where the author can see them."""

from collections.abc import Iterator
from typing import Any, Protocol, TypeVar

from advercity_dsl import Declaration, Model
from advercity_dsl.base import Misfit
from pydantic import ValidationError

from advercity.compiler.docstrings import described
from advercity.compiler.extension import ABOUT_THE_FILE
from advercity.compiler.fields import field_names, models_at
from advercity.compiler.problems import Problem, ProblemsError, nearest
from advercity.compiler.source import Where
from advercity.compiler.wording import Complaint, words_for

ModelT = TypeVar("ModelT", bound=Model)


class Located(Protocol):
    """Data that knows where each of its values is written."""

    @property
    def data(self) -> Any:
        """Plain values."""
        ...

    def has(self, where: Where) -> bool:
        """Whether there is a value at `where`."""
        ...

    def problem(self, where: Where, message: str, *, hint: str = "", key: bool = False) -> Problem:
        """A problem with the value (or key) at `where`."""
        ...


def validate(
    model: type[ModelT], source: Located, data: Any = None, *, known: tuple[Problem, ...] = ()
) -> ModelT:
    """`model` made of the source's data, or of `data` in its place.

    Args:
        model: What to make.
        source: Where values are written.
        data: Stands in for the source's data, with values of its own.
        known: Problems found before, to be told along with those found here.
    """
    try:
        made = model.model_validate(source.data if data is None else data)
    except ValidationError as error:
        told = {problem.where for problem in known if problem.where}
        found = [item for item in problems_of(model, source, error) if item.where not in told]
        raise ProblemsError([*known, *found]) from None
    if known:
        raise ProblemsError(known)
    return made


def problems_of(
    model: type[Model], source: Located, error: ValidationError, *, at: Where = ()
) -> Iterator[Problem]:
    """What pydantic found, each at its place; `at` is where the model stands in the source."""
    details = [item for item in error.errors(include_url=False) if not _is_echo(item)]
    for detail in _of_best_alternative(source, details, at):
        where = _in_source(source, detail["loc"], at)
        yield _problem(model, source, detail, where)


def _problem(model: type[Model], source: Located, detail: Any, where: Where) -> Problem:
    loc: Where = detail["loc"]
    kind = detail["type"]
    if kind == "extra_forbidden":
        name = str(loc[-1])
        names = field_names(model, loc[:-1]) + ([] if loc[:-1] else _about_the_file(model))
        hint = _misplaced(name) or nearest(name, names)
        return source.problem(where, "no such field", hint=hint, key=True)
    if kind == "missing":
        if isinstance(loc[-1], int):
            return source.problem(where[:-1] if loc[-1:] == where[-1:] else where, _too_few(loc))
        hint = _add(model, loc)
        return source.problem(where, f"the field '{loc[-1]}' is missing", hint=hint)
    if kind == "value_error":
        reason = detail["ctx"]["error"]
        if isinstance(reason, Misfit):
            first, other = (*where, *reason.where), (*where, *reason.otherwise)
            shown = first if source.has(first) or not source.has(other) else other
            return source.problem(shown, reason.message, hint=reason.hint)
        return source.problem(where, str(reason), key=loc[-1:] == ("[key]",))
    complaint = Complaint(model, detail["input"], loc, detail.get("ctx", {}), detail["msg"])
    message, hint = words_for(kind, complaint)
    if kind == "union_tag_invalid" and "kind" in detail["ctx"]["discriminator"]:
        where = (*where, detail["ctx"]["discriminator"].strip("'"))
    return source.problem(where, message, hint=hint)


def _about_the_file(model: type[Model]) -> list[str]:
    return list(ABOUT_THE_FILE) if issubclass(model, Declaration) else []


def _is_echo(detail: Any) -> bool:
    """Whether a list is too short only for want of those items that are told of anyway."""
    return detail["type"] == "too_short" and len(detail["input"]) >= detail["ctx"]["min_length"]


def _add(model: type[Model], loc: Where) -> str:
    """What a missing field is for, as its model says."""
    name = str(loc[-1])
    for fields in (described(found) for found in models_at(model, loc[:-1])):
        for texts in fields.values():
            if name in texts:
                return f"add it: {texts[name][0].lower()}{texts[name][1:].rstrip('.')}"
    return "add it"


def _misplaced(name: str) -> str:
    if ":" in name:
        return "put a space after the colon"
    if name == "<<":
        return "merge keys of YAML are not used here; write `extends:` with an id"
    return ""


def _too_few(loc: Where) -> str:
    return f"has too few values; number {int(loc[-1]) + 1} is missing"


def _in_source(source: Located, loc: Where, at: Where) -> Where:
    """`loc` without the tags that pydantic puts in for the alternatives of a union."""
    where = at
    for part in loc:
        if source.has((*where, part)):
            where = (*where, part)
    return where


def _of_best_alternative(source: Located, details: list[Any], at: Where) -> list[Any]:
    """Of a union's alternatives, only the complaints of the one that fits best."""
    by_value: dict[Where, dict[str, list[Any]]] = {}
    kept: list[Any] = []
    for detail in details:
        split = _union_split(source, detail["loc"], at)
        if split is None:
            kept.append(detail)
        else:
            by_value.setdefault(split[0], {}).setdefault(split[1], []).append(detail)
    for alternatives in by_value.values():
        kept += min(alternatives.values(), key=_misfit)
    return kept


def _misfit(complaints: list[Any]) -> tuple[int, int]:
    """How badly an alternative fits: unknown or missing fields weigh more than wrong values."""
    structural = sum(
        item["type"] in ("missing", "extra_forbidden", "model_type", "tuple_type")
        for item in complaints
    )
    return structural, len(complaints)


def _union_split(source: Located, loc: Where, at: Where) -> tuple[Where, str] | None:
    """The value that a union is about and the alternative's name, if `loc` passes one."""
    where = at
    for part in loc[:-1] if len(loc) > 1 else loc:
        if source.has((*where, part)):
            where = (*where, part)
        elif isinstance(part, str):
            return where, part
    return None

"""Says what is wrong with a value, and the way out, in the words of those who write declarations.

A function a type of pydantic's errors; what none of them knows keeps pydantic's words.

From located data to models, with pydantic's errors put where the author can see them.
"""

import math
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple, Protocol, TypeVar

from advercity_dsl import Declaration, Model
from advercity_dsl.base import InvalidCombination, suggest_name
from pydantic import ValidationError

from advercity.compiler.diagnostics import Diagnostic, DiagnosticsError
from advercity.compiler.extends import DOCUMENT_KEYS
from advercity.compiler.fields import (
    NumberConstraints,
    collect_field_docs,
    find_field_names,
    find_models,
    find_number_constraints,
)
from advercity.compiler.source import ValuePath

YAML_1_1_BOOLEANS = {
    "on": "true",
    "yes": "true",
    "y": "true",
    "off": "false",
    "no": "false",
    "n": "false",
}
"""What YAML 1.1 took for truth values; text here."""
ID_HINT = "lower-case letters, digits and _, at most 64, starting with a letter"

MessageAndHint = tuple[str, str]
"""What is wrong, and the way out; the latter may be empty."""


class FieldError(NamedTuple):
    """What pydantic says of a value.

    Attributes:
        model: That the value is for.
        value: As it was found.
        loc: From the model, with the tags of unions.
        context: What belongs to the type of the error: lengths, a pattern, what was expected.
        message: Pydantic's own.
    """

    model: type[Model]
    value: Any
    loc: ValuePath
    context: dict[str, Any]
    message: str


def describe_field_error(kind: str, error: FieldError) -> MessageAndHint:
    """What is wrong with a value, and the way out.

    Args:
        kind: Type of pydantic's error.
        error: The rest of it.
    """
    words = _DESCRIBERS[kind](error) if kind in _DESCRIBERS else None
    return words or _describe_as_pydantic(error)


def format_value(value: Any) -> str:
    """A value as it is shown in a message: short, text in quotes."""
    if value is None:
        return "null"
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, dict):
        return "a mapping"
    if isinstance(value, list | tuple):
        return "a list"
    text = str(value)
    text = text if len(text) <= 40 else f"{text[:37]}..."
    return f"'{text}'" if isinstance(value, str) else text


def _describe_out_of_range(complaint: FieldError) -> MessageAndHint | None:
    value, facts = complaint.value, find_number_constraints(complaint.model, complaint.loc)
    if facts is None or not facts.range_text:
        return None
    unit = f" {facts.unit.name}" if facts.unit and facts.unit.name != "1" else ""
    written = value if isinstance(value, str) else f"{value:.12g}{unit}"
    return f"{written} is outside the range of {facts.range_text}", _suggest_percentage(
        facts, value
    )


def _suggest_percentage(facts: NumberConstraints, value: Any) -> str:
    """The reason of a range; of a share, what a percentage would be."""
    is_share = facts.unit is not None and facts.unit.name == "1"
    if is_share and isinstance(value, int | float) and 1 < value <= 100:
        return f"write {value:g} % or {value / 100:g}"
    return facts.reason


def _describe_infinite(_: FieldError) -> MessageAndHint:
    return "a number must end somewhere; this is infinite", "write a finite number"


def _describe_non_integer(complaint: FieldError) -> MessageAndHint:
    value = complaint.value
    if not isinstance(value, float):
        return _describe_non_number(complaint)
    if not math.isfinite(value):
        return _describe_infinite(complaint)
    return f"{value:g} is no whole number", f"write {math.floor(value)} or {math.ceil(value)}"


def _describe_non_number(complaint: FieldError) -> MessageAndHint:
    value, facts = complaint.value, find_number_constraints(complaint.model, complaint.loc)
    example = f", or a quantity such as {facts.unit.example}" if facts and facts.unit else ""
    if isinstance(value, dict):
        if len(value) == 1 and next(iter(value)) in ("uniform", "normal", "choice"):
            hint = "distributions are for numbers of a weather and for what a conflict draws"
            return "a distribution cannot stand here", hint
        return "a mapping stands where a number should", f"write a number{example}"
    if value is None:
        return "there is no value", f"write a number{example}, or leave the field out"
    return f"{format_value(value)} is no number", f"write a number{example}"


def _describe_non_boolean(complaint: FieldError) -> MessageAndHint:
    meant = YAML_1_1_BOOLEANS.get(str(complaint.value).lower())
    return (
        f"{format_value(complaint.value)} is not true or false",
        f"write {meant or 'true or false'}",
    )


def _describe_non_string(complaint: FieldError) -> MessageAndHint:
    plain = isinstance(complaint.value, int | float)
    hint = f'write it in quotes: "{complaint.value}"' if plain else ""
    return f"{format_value(complaint.value)} is no text", hint


def _describe_invalid_id(complaint: FieldError) -> MessageAndHint | None:
    if not complaint.context["pattern"].startswith("^[a-z][a-z0-9_]{0,"):
        return None
    return f"'{complaint.value}' is not an id", ID_HINT


def _describe_unknown_choice(complaint: FieldError) -> MessageAndHint:
    valid = _split_list(complaint.context["expected"].replace(" or ", ","))
    return f"{format_value(complaint.value)} does not stand here", suggest_name(
        str(complaint.value), valid
    )


def _describe_non_mapping(complaint: FieldError) -> MessageAndHint:
    names = find_field_names(complaint.model, complaint.loc)
    hint = f"fields here: {', '.join(names)}" if names else "write `name: value`"
    return f"{format_value(complaint.value)} is no mapping", hint


def _describe_non_list(complaint: FieldError) -> MessageAndHint:
    return f"{format_value(complaint.value)} is no list", "write it as [first, second]"


def _describe_too_short(complaint: FieldError) -> MessageAndHint:
    least, found = complaint.context["min_length"], complaint.context["actual_length"]
    return f"must have at least {least} of these, has {found}", ""


def _describe_too_long(complaint: FieldError) -> MessageAndHint:
    most, found = complaint.context["max_length"], complaint.context["actual_length"]
    return f"must have at most {most} of these, has {found}", ""


def _describe_missing_kind(_: FieldError) -> MessageAndHint:
    return "the field 'kind' is missing", "it says what this is"


def _describe_unknown_kind(complaint: FieldError) -> MessageAndHint:
    tag = complaint.context["tag"]
    return f"no such kind: '{tag}'", suggest_name(
        tag, _split_list(complaint.context["expected_tags"])
    )


def _describe_as_pydantic(complaint: FieldError) -> MessageAndHint:
    message, value = complaint.message, complaint.value
    found = f" (found {format_value(value)})" if isinstance(value, str | int | float | bool) else ""
    return f"{message[0].lower()}{message[1:]}{found}", ""


def _split_list(text: str) -> list[str]:
    return [item.strip(" '") for item in text.split(",")]


_DESCRIBERS: dict[str, Callable[[FieldError], MessageAndHint | None]] = {
    **dict.fromkeys(
        ("greater_than", "greater_than_equal", "less_than", "less_than_equal"),
        _describe_out_of_range,
    ),
    "finite_number": _describe_infinite,
    "int_type": _describe_non_integer,
    "int_from_float": _describe_non_integer,
    "float_type": _describe_non_number,
    "bool_type": _describe_non_boolean,
    "string_type": _describe_non_string,
    "string_pattern_mismatch": _describe_invalid_id,
    "literal_error": _describe_unknown_choice,
    "enum": _describe_unknown_choice,
    "model_type": _describe_non_mapping,
    "dict_type": _describe_non_mapping,
    "model_attributes_type": _describe_non_mapping,
    "tuple_type": _describe_non_list,
    "list_type": _describe_non_list,
    "too_short": _describe_too_short,
    "too_long": _describe_too_long,
    "union_tag_not_found": _describe_missing_kind,
    "union_tag_invalid": _describe_unknown_kind,
}


ModelT = TypeVar("ModelT", bound=Model)


class LocatedData(Protocol):
    """Data that knows where each of its values is written."""

    @property
    def data(self) -> Any:
        """Plain values."""
        ...

    def has_value(self, where: ValuePath) -> bool:
        """Whether there is a value at `where`."""
        ...

    def build_diagnostic(
        self, where: ValuePath, message: str, *, hint: str = "", key: bool = False
    ) -> Diagnostic:
        """A problem with the value (or key) at `where`."""
        ...


def validate_model(
    model: type[ModelT],
    source: LocatedData,
    data: Any = None,
    *,
    known: tuple[Diagnostic, ...] = (),
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
        told = {problem.value_path for problem in known if problem.value_path}
        found = [
            item for item in build_diagnostics(model, source, error) if item.value_path not in told
        ]
        raise DiagnosticsError([*known, *found]) from None
    if known:
        raise DiagnosticsError(known)
    return made


def build_diagnostics(
    model: type[Model], source: LocatedData, error: ValidationError, *, at: ValuePath = ()
) -> Iterator[Diagnostic]:
    """What pydantic found, each at its place; `at` is where the model stands in the source."""
    details = [item for item in error.errors(include_url=False) if not _is_consequence(item)]
    for detail in _keep_best_alternative(source, details, at):
        where = _find_source_path(source, detail["loc"], at)
        yield _build_field_diagnostic(model, source, detail, where)


def _build_field_diagnostic(
    model: type[Model], source: LocatedData, detail: Any, where: ValuePath
) -> Diagnostic:
    loc: ValuePath = detail["loc"]
    kind = detail["type"]
    if kind == "extra_forbidden":
        name = str(loc[-1])
        names = find_field_names(model, loc[:-1]) + ([] if loc[:-1] else _get_document_keys(model))
        hint = _suggest_yaml_fix(name) or suggest_name(name, names)
        return source.build_diagnostic(where, "no such field", hint=hint, key=True)
    if kind == "missing":
        if isinstance(loc[-1], int):
            return source.build_diagnostic(
                where[:-1] if loc[-1:] == where[-1:] else where, _describe_missing_item(loc)
            )
        hint = _suggest_missing_field(model, loc)
        return source.build_diagnostic(where, f"the field '{loc[-1]}' is missing", hint=hint)
    if kind == "value_error":
        reason = detail["ctx"]["error"]
        if isinstance(reason, InvalidCombination):
            first, other = (*where, *reason.value_path), (*where, *reason.other_path)
            shown = first if source.has_value(first) or not source.has_value(other) else other
            return source.build_diagnostic(shown, reason.message, hint=reason.hint)
        return source.build_diagnostic(where, str(reason), key=loc[-1:] == ("[key]",))
    complaint = FieldError(model, detail["input"], loc, detail.get("ctx", {}), detail["msg"])
    message, hint = describe_field_error(kind, complaint)
    if kind == "union_tag_invalid" and "kind" in detail["ctx"]["discriminator"]:
        where = (*where, detail["ctx"]["discriminator"].strip("'"))
    return source.build_diagnostic(where, message, hint=hint)


def _get_document_keys(model: type[Model]) -> list[str]:
    return list(DOCUMENT_KEYS) if issubclass(model, Declaration) else []


def _is_consequence(detail: Any) -> bool:
    """Whether a list is too short only for want of those items that are told of anyway."""
    return detail["type"] == "too_short" and len(detail["input"]) >= detail["ctx"]["min_length"]


def _suggest_missing_field(model: type[Model], loc: ValuePath) -> str:
    """What a missing field is for, as its model says."""
    name = str(loc[-1])
    for fields in (collect_field_docs(found) for found in find_models(model, loc[:-1])):
        for texts in fields.values():
            if name in texts:
                return f"add it: {texts[name][0].lower()}{texts[name][1:].rstrip('.')}"
    return "add it"


def _suggest_yaml_fix(name: str) -> str:
    if ":" in name:
        return "put a space after the colon"
    if name == "<<":
        return "merge keys of YAML are not used here; write `extends:` with an id"
    return ""


def _describe_missing_item(loc: ValuePath) -> str:
    return f"has too few values; number {int(loc[-1]) + 1} is missing"


def _find_source_path(source: LocatedData, loc: ValuePath, at: ValuePath) -> ValuePath:
    """`loc` without the tags that pydantic puts in for the alternatives of a union."""
    where = at
    for part in loc:
        if source.has_value((*where, part)):
            where = (*where, part)
    return where


def _keep_best_alternative(source: LocatedData, details: list[Any], at: ValuePath) -> list[Any]:
    """Of a union's alternatives, only the complaints of the one that fits best."""
    by_value: dict[ValuePath, dict[str, list[Any]]] = {}
    kept: list[Any] = []
    for detail in details:
        split = _split_union_path(source, detail["loc"], at)
        if split is None:
            kept.append(detail)
        else:
            by_value.setdefault(split[0], {}).setdefault(split[1], []).append(detail)
    for alternatives in by_value.values():
        kept += min(alternatives.values(), key=_score_mismatch)
    return kept


def _score_mismatch(complaints: list[Any]) -> tuple[int, int]:
    """How badly an alternative fits: unknown or missing fields weigh more than wrong values."""
    structural = sum(
        item["type"] in ("missing", "extra_forbidden", "model_type", "tuple_type")
        for item in complaints
    )
    return structural, len(complaints)


def _split_union_path(
    source: LocatedData, loc: ValuePath, at: ValuePath
) -> tuple[ValuePath, str] | None:
    """The value that a union is about and the alternative's name, if `loc` passes one."""
    where = at
    for part in loc[:-1] if len(loc) > 1 else loc:
        if source.has_value((*where, part)):
            where = (*where, part)
        elif isinstance(part, str):
            return where, part
    return None

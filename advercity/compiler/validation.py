"""Validation of located data against models, with pydantic's errors in the author's terms.

A function describes each type of pydantic's errors; other types keep pydantic's text.
"""

import math
from collections.abc import Callable, Collection, Iterator, Mapping
from typing import Any, NamedTuple, Protocol, TypeVar

from advercity_dsl import Declaration, Model, Weather
from advercity_dsl.base import ID_HINT, InvalidCombination, ValuePath, suggest_name
from advercity_dsl.suite import PATTERN_OF_IDS
from pydantic import ValidationError

from advercity.compiler.carla_weather import suggest_for_carla_field
from advercity.compiler.extends import DOCUMENT_KEYS
from advercity.compiler.fields import (
    NumberConstraints,
    collect_field_docs,
    find_field_names,
    find_models,
    find_number_constraints,
    find_tags,
)
from advercity.compiler.source import format_value_path
from advercity.diagnostics import MAX_LISTED, Diagnostic, DiagnosticsError

YAML_1_1_BOOLEANS = {
    "on": "true",
    "yes": "true",
    "y": "true",
    "off": "false",
    "no": "false",
    "n": "false",
}
"""Booleans of YAML 1.1, which are text here."""

MAX_DESCRIBED = 2 * MAX_LISTED
MessageAndHint = tuple[str, str]
"""The error, and its correction; the hint may be empty."""


class FieldError(NamedTuple):
    """One error of pydantic.

    Attributes:
        model: Model against which the data was validated.
        value: The invalid value.
        loc: Its location in the model, including tags of unions.
        context: Details by the type of the error: lengths, a pattern, expected values.
        message: Pydantic's message.
    """

    model: type[Model]
    value: Any
    loc: ValuePath
    context: dict[str, Any]
    message: str


def describe_field_error(kind: str, error: FieldError) -> MessageAndHint:
    """Describe an error of pydantic of the type `kind`."""
    description = _DESCRIBERS[kind](error) if kind in _DESCRIBERS else None
    return description or _describe_as_pydantic(error)


def format_value(value: Any) -> str:
    """Format a value for a message: shortened, text in quotes, no content of collections."""
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


def _describe_out_of_range(error: FieldError) -> MessageAndHint | None:
    value, constraints = error.value, find_number_constraints(error.model, error.loc)
    if constraints is None or not constraints.range_text:
        return None
    number = f"{value:.12g}" if isinstance(value, float) else format_value(value)
    written = value if isinstance(value, str) else f"{number} {constraints.unit_name}".rstrip()
    message = f"{written} is outside the range of {constraints.range_text}"
    return message, _suggest_percentage(constraints, value)


def _suggest_percentage(constraints: NumberConstraints, value: Any) -> str:
    """Return the reason of a range, or for a fraction above 1 how to write it as a percentage."""
    is_fraction = constraints.unit is not None and constraints.unit.name == "1"
    if is_fraction and isinstance(value, int | float) and 1 < value <= 100:
        return f"write {value:g} % or {value / 100:g}"
    return constraints.reason


def _describe_infinite(_: FieldError) -> MessageAndHint:
    return "the number is infinite", "write a finite number"


def _describe_non_integer(error: FieldError) -> MessageAndHint:
    value = error.value
    if not isinstance(value, float):
        return _describe_non_number(error)
    if not math.isfinite(value):
        return _describe_infinite(error)
    return f"{value:g} is not an integer", f"write {math.floor(value)} or {math.ceil(value)}"


def _describe_non_number(error: FieldError) -> MessageAndHint:
    value, constraints = error.value, find_number_constraints(error.model, error.loc)
    unit = constraints.unit if constraints else None
    example = f", or a quantity such as {unit.example}" if unit else ""
    if isinstance(value, dict):
        if len(value) == 1 and next(iter(value)) in ("uniform", "normal", "choice"):
            hint = "distributions are for numbers of weathers and parameters of conflicts"
            return "a distribution is not allowed here", hint
        return "expected a number, found a mapping", f"write a number{example}"
    if value is None:
        return "the value is missing", f"write a number{example}, or remove the field"
    return f"{format_value(value)} is not a number", f"write a number{example}"


def _describe_non_boolean(error: FieldError) -> MessageAndHint:
    meant = YAML_1_1_BOOLEANS.get(str(error.value).lower(), "true or false")
    return f"{format_value(error.value)} is not true or false", f"write {meant}"


def _describe_non_string(error: FieldError) -> MessageAndHint:
    is_plain = isinstance(error.value, int | float)
    hint = f'write it in quotes: "{error.value}"' if is_plain else ""
    return f"{format_value(error.value)} is not text", hint


def _describe_invalid_id(error: FieldError) -> MessageAndHint | None:
    # All patterns of ids begin like this; other patterns keep pydantic's message.
    if error.context["pattern"] == PATTERN_OF_IDS:
        return f"'{error.value}' is neither an id nor a pattern of ids such as fog_*", ID_HINT
    if not error.context["pattern"].startswith("^[a-z][a-z0-9_]{0,"):
        return None
    return f"'{error.value}' is not an id", ID_HINT


def _describe_unknown_choice(error: FieldError) -> MessageAndHint:
    # pydantic joins the choices to one text: "'a', 'b' or 'c'".
    valid = _split_list(error.context["expected"].replace(" or ", ","))
    message = f"{format_value(error.value)} is not allowed here"
    similar, all_choices = (suggest_name(name, valid) for name in (str(error.value), ""))
    return message, similar if similar == all_choices else f"{similar} {all_choices}"


def _describe_non_mapping(error: FieldError) -> MessageAndHint:
    names = find_field_names(error.model, error.loc)
    hint = f"fields: {', '.join(names)}" if names else "write `name: value`"
    return f"{format_value(error.value)} is not a mapping", hint


def _describe_non_list(error: FieldError) -> MessageAndHint:
    return f"{format_value(error.value)} is not a list", "write it as [first, second]"


def _describe_too_short(error: FieldError) -> MessageAndHint:
    least, length = error.context["min_length"], error.context["actual_length"]
    return f"expected {least} or more items, found {length}", ""


def _describe_too_long(error: FieldError) -> MessageAndHint:
    most, length = error.context["max_length"], error.context["actual_length"]
    return f"expected at most {most} items, found {length}", ""


def _describe_missing_tag(error: FieldError) -> MessageAndHint:
    field = _find_tag_field(error.context) or "kind"
    models = find_models(error.model, error.loc)
    tags = sorted({tag for model in models for tag in find_tags(model)})
    return f"the field '{field}' is missing", f"add it, one of: {', '.join(tags)}"


def _describe_unknown_tag(error: FieldError) -> MessageAndHint:
    tag, valid = error.context["tag"], _split_list(error.context["expected_tags"])
    return f"unknown {_find_tag_field(error.context) or 'kind'} '{tag}'", suggest_name(tag, valid)


def _find_tag_field(context: Mapping[str, Any]) -> str | None:
    """Find the field that selects an alternative; pydantic quotes fields, but not functions."""
    discriminator: str = context["discriminator"]
    return discriminator.strip("'") if discriminator.startswith("'") else None


def _describe_as_pydantic(error: FieldError) -> MessageAndHint:
    message, value = error.message, error.value
    found = f" (found {format_value(value)})" if isinstance(value, str | int | float | bool) else ""
    return f"{message[0].lower()}{message[1:]}{found}", ""


def _split_list(text: str) -> list[str]:
    return [item.strip(" '") for item in text.split(",")]


_DESCRIBERS: dict[str, Callable[[FieldError], MessageAndHint | None]] = {
    "greater_than": _describe_out_of_range,
    "greater_than_equal": _describe_out_of_range,
    "less_than": _describe_out_of_range,
    "less_than_equal": _describe_out_of_range,
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
    "union_tag_not_found": _describe_missing_tag,
    "union_tag_invalid": _describe_unknown_tag,
}


ModelT = TypeVar("ModelT", bound=Model)


class LocatedData(Protocol):
    """Data with the positions of its values in files."""

    @property
    def data(self) -> Any:
        """Plain values."""
        ...

    def has_value(self, value_path: ValuePath) -> bool:
        """Return whether the data has a value at a path."""
        ...

    def build_diagnostic(
        self, value_path: ValuePath, message: str, *, hint: str = "", key: bool = False
    ) -> Diagnostic:
        """Build a diagnostic at a value (or key)."""
        ...


def validate_model(
    model: type[ModelT],
    source: LocatedData,
    data: Any = None,
    *,
    previous: tuple[Diagnostic, ...] = (),
    malformed: Collection[ValuePath] = (),
) -> ModelT:
    """Build a model from the source's data.

    Args:
        model: Class of the model.
        source: Data with positions.
        data: Data to use instead, with values not in the source.
        previous: Earlier diagnostics, to report together with the new ones.
        malformed: Paths of values with an error in `previous`.

    Raises:
        DiagnosticsError: The data is not valid, or `previous` is not empty.
    """
    try:
        instance = model.model_validate(source.data if data is None else data)
    except ValidationError as error:
        # A value with a parsing error is reported once, not again as missing.
        reported = {item.value_path for item in previous if item.value_path}
        reported.update(map(format_value_path, malformed))
        diagnostics = build_diagnostics(model, source, error)
        new = [item for item in diagnostics if item.value_path not in reported]
        raise DiagnosticsError(*previous, *new) from None
    if previous:
        raise DiagnosticsError(*previous)
    return instance


def build_diagnostics(
    model: type[Model], source: LocatedData, error: ValidationError, *, at: ValuePath = ()
) -> Iterator[Diagnostic]:
    """Yield a diagnostic for each error of pydantic; `at` is the model's path in the source."""
    # No reader looks at thousands of errors, which take seconds to describe.
    found = error.errors(include_url=False)[:MAX_DESCRIBED]
    details = [item for item in found if not _is_consequence(item)]
    for detail in _keep_best_alternative(source, details, at):
        value_path = _find_source_path(source, detail["loc"], at)
        yield _build_field_diagnostic(model, source, detail, value_path)


def _build_field_diagnostic(
    model: type[Model], source: LocatedData, detail: Any, value_path: ValuePath
) -> Diagnostic:
    loc: ValuePath = detail["loc"]
    match detail["type"]:
        case "extra_forbidden":
            hint = _suggest_field(model, loc)
            return source.build_diagnostic(value_path, "no such field", hint=hint, key=True)
        case "missing":
            return _build_missing_diagnostic(model, source, loc, value_path)
        case "value_error":
            return _build_combination_diagnostic(source, detail, value_path)
        case kind:
            error = FieldError(model, detail["input"], loc, detail.get("ctx", {}), detail["msg"])
            message, hint = describe_field_error(kind, error)
    # Points at the tag itself.
    if kind == "union_tag_invalid" and (field := _find_tag_field(detail["ctx"])):
        value_path = (*value_path, field)
    return source.build_diagnostic(value_path, message, hint=hint)


def _suggest_field(model: type[Model], loc: ValuePath) -> str:
    """Return the most similar field, or the correction of a key misread by YAML."""
    name = str(loc[-1])
    if ":" in name:
        return "put a space after the colon"
    if issubclass(model, Weather) and (known := suggest_for_carla_field(loc)):
        return known
    # `extends` and `version` belong to documents; no model has them as fields.
    is_document = len(loc) == 1 and issubclass(model, Declaration)
    names = find_field_names(model, loc[:-1]) + (list(DOCUMENT_KEYS) if is_document else [])
    return suggest_name(name, names)


def _build_missing_diagnostic(
    model: type[Model], source: LocatedData, loc: ValuePath, value_path: ValuePath
) -> Diagnostic:
    name = loc[-1]
    if isinstance(name, int):
        parent = value_path[:-1] if value_path[-1:] == (name,) else value_path
        return source.build_diagnostic(parent, f"has too few values; number {name + 1} is missing")
    hint = "add it"
    for found in find_models(model, loc[:-1]):
        text = next((docs[name] for docs in collect_field_docs(found).values() if name in docs), "")
        if text:
            hint = f"add it: {text[0].lower()}{text[1:].rstrip('.')}"
            break
    return source.build_diagnostic(value_path, f"the field '{name}' is missing", hint=hint)


def _build_combination_diagnostic(
    source: LocatedData, detail: Any, value_path: ValuePath
) -> Diagnostic:
    reason = detail["ctx"]["error"]
    if not isinstance(reason, InvalidCombination):
        is_key = detail["loc"][-1:] == ("[key]",)
        return source.build_diagnostic(value_path, str(reason), key=is_key)
    # If the first value is a default, the author can only see the other one.
    first, other = (*value_path, *reason.value_path), (*value_path, *reason.other_path)
    shown = first if source.has_value(first) or not source.has_value(other) else other
    return source.build_diagnostic(shown, reason.message, hint=reason.hint)


def _is_consequence(detail: Any) -> bool:
    """Return whether a list is too short only because its invalid items were dropped."""
    return detail["type"] == "too_short" and len(detail["input"]) >= detail["ctx"]["min_length"]


def _find_source_path(source: LocatedData, loc: ValuePath, at: ValuePath) -> ValuePath:
    """Remove from `loc` pydantic's tags for the alternatives of a union."""
    value_path = at
    for part in loc:
        if source.has_value((*value_path, part)):
            value_path = (*value_path, part)
    return value_path


def _keep_best_alternative(source: LocatedData, details: list[Any], at: ValuePath) -> list[Any]:
    """Drop the errors of all alternatives of a union but the best match, others unchanged."""
    # pydantic reports every failed alternative of a union, which is all of them.
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


def _score_mismatch(details: list[Any]) -> tuple[int, int]:
    """Score an alternative: unknown or missing fields count more than invalid values."""
    structural = sum(
        detail["type"] in ("missing", "extra_forbidden", "model_type", "tuple_type")
        for detail in details
    )
    return structural, len(details)


def _split_union_path(
    source: LocatedData, loc: ValuePath, at: ValuePath
) -> tuple[ValuePath, str] | None:
    """Return the path of a union's value and the alternative's name, if `loc` contains one."""
    value_path = at
    for part in loc[:-1] if len(loc) > 1 else loc:
        if source.has_value((*value_path, part)):
            value_path = (*value_path, part)
        elif isinstance(part, str):
            # A part not in the source is the name of an alternative.
            return value_path, part
    return None

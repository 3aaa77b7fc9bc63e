"""Says what is wrong with a value, and the way out, in the words of those who write declarations.

A function a type of pydantic's errors; what none of them knows keeps pydantic's words.
"""

import math
from collections.abc import Callable
from typing import Any, NamedTuple

from advercity_dsl import Model

from advercity.compiler.fields import Facts, facts_at, field_names
from advercity.compiler.problems import nearest
from advercity.compiler.source import Where

TRUTHS = {"on": "true", "yes": "true", "y": "true", "off": "false", "no": "false", "n": "false"}
"""What YAML 1.1 took for truth values; text here."""
ID_HINT = "lower-case letters, digits and _, at most 64, starting with a letter"

Words = tuple[str, str]
"""What is wrong, and the way out; the latter may be empty."""


class Complaint(NamedTuple):
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
    loc: Where
    context: dict[str, Any]
    message: str


def words_for(kind: str, complaint: Complaint) -> Words:
    """What is wrong with a value, and the way out.

    Args:
        kind: Type of pydantic's error.
        complaint: The rest of it.
    """
    words = _WORDS[kind](complaint) if kind in _WORDS else None
    return words or _as_pydantic_says(complaint)


def quoted(value: Any) -> str:
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


def _outside(complaint: Complaint) -> Words | None:
    value, facts = complaint.value, facts_at(complaint.model, complaint.loc)
    if facts is None or not facts.range:
        return None
    unit = f" {facts.unit.name}" if facts.unit and facts.unit.name != "1" else ""
    written = value if isinstance(value, str) else f"{value:.12g}{unit}"
    return f"{written} is outside the range of {facts.range}", _as_percent(facts, value)


def _as_percent(facts: Facts, value: Any) -> str:
    """The reason of a range; of a share, what a percentage would be."""
    is_share = facts.unit is not None and facts.unit.name == "1"
    if is_share and isinstance(value, int | float) and 1 < value <= 100:
        return f"write {value:g} % or {value / 100:g}"
    return facts.reason


def _infinite(_: Complaint) -> Words:
    return "a number must end somewhere; this is infinite", "write a finite number"


def _no_whole_number(complaint: Complaint) -> Words:
    value = complaint.value
    if not isinstance(value, float):
        return _no_number(complaint)
    if not math.isfinite(value):
        return _infinite(complaint)
    return f"{value:g} is no whole number", f"write {math.floor(value)} or {math.ceil(value)}"


def _no_number(complaint: Complaint) -> Words:
    value, facts = complaint.value, facts_at(complaint.model, complaint.loc)
    example = f", or a quantity such as {facts.unit.example}" if facts and facts.unit else ""
    if isinstance(value, dict):
        if len(value) == 1 and next(iter(value)) in ("uniform", "normal", "choice"):
            hint = "distributions are for numbers of a weather and for what a conflict draws"
            return "a distribution cannot stand here", hint
        return "a mapping stands where a number should", f"write a number{example}"
    if value is None:
        return "there is no value", f"write a number{example}, or leave the field out"
    return f"{quoted(value)} is no number", f"write a number{example}"


def _no_truth_value(complaint: Complaint) -> Words:
    meant = TRUTHS.get(str(complaint.value).lower())
    return f"{quoted(complaint.value)} is not true or false", f"write {meant or 'true or false'}"


def _no_text(complaint: Complaint) -> Words:
    plain = isinstance(complaint.value, int | float)
    hint = f'write it in quotes: "{complaint.value}"' if plain else ""
    return f"{quoted(complaint.value)} is no text", hint


def _no_id(complaint: Complaint) -> Words | None:
    if not complaint.context["pattern"].startswith("^[a-z][a-z0-9_]{0,"):
        return None
    return f"'{complaint.value}' is not an id", ID_HINT


def _no_such_word(complaint: Complaint) -> Words:
    valid = _listed(complaint.context["expected"].replace(" or ", ","))
    return f"{quoted(complaint.value)} does not stand here", nearest(str(complaint.value), valid)


def _no_mapping(complaint: Complaint) -> Words:
    names = field_names(complaint.model, complaint.loc)
    hint = f"fields here: {', '.join(names)}" if names else "write `name: value`"
    return f"{quoted(complaint.value)} is no mapping", hint


def _no_list(complaint: Complaint) -> Words:
    return f"{quoted(complaint.value)} is no list", "write it as [first, second]"


def _too_short(complaint: Complaint) -> Words:
    least, found = complaint.context["min_length"], complaint.context["actual_length"]
    return f"must have at least {least} of these, has {found}", ""


def _too_long(complaint: Complaint) -> Words:
    most, found = complaint.context["max_length"], complaint.context["actual_length"]
    return f"must have at most {most} of these, has {found}", ""


def _no_kind(_: Complaint) -> Words:
    return "the field 'kind' is missing", "it says what this is"


def _no_such_kind(complaint: Complaint) -> Words:
    tag = complaint.context["tag"]
    return f"no such kind: '{tag}'", nearest(tag, _listed(complaint.context["expected_tags"]))


def _as_pydantic_says(complaint: Complaint) -> Words:
    message, value = complaint.message, complaint.value
    found = f" (found {quoted(value)})" if isinstance(value, str | int | float | bool) else ""
    return f"{message[0].lower()}{message[1:]}{found}", ""


def _listed(text: str) -> list[str]:
    return [item.strip(" '") for item in text.split(",")]


_WORDS: dict[str, Callable[[Complaint], Words | None]] = {
    **dict.fromkeys(
        ("greater_than", "greater_than_equal", "less_than", "less_than_equal"), _outside
    ),
    "finite_number": _infinite,
    "int_type": _no_whole_number,
    "int_from_float": _no_whole_number,
    "float_type": _no_number,
    "bool_type": _no_truth_value,
    "string_type": _no_text,
    "string_pattern_mismatch": _no_id,
    "literal_error": _no_such_word,
    "enum": _no_such_word,
    "model_type": _no_mapping,
    "dict_type": _no_mapping,
    "model_attributes_type": _no_mapping,
    "tuple_type": _no_list,
    "list_type": _no_list,
    "too_short": _too_short,
    "too_long": _too_long,
    "union_tag_not_found": _no_kind,
    "union_tag_invalid": _no_such_kind,
}

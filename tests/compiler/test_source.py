from pathlib import Path

from advercity.compiler.crossing import compile_library
from advercity.compiler.source import parse_document
from tests.builders import Write, describe_errors


def test_an_alias_bomb_is_reported_and_not_expanded(write: Write) -> None:
    rows = ["a0: &a0 [x, x, x, x, x, x, x, x, x, x]"]
    rows += [f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 10)}]" for i in range(1, 9)]
    text = describe_errors(write(weather="\n".join(["kind: weather", "id: x", *rows])))
    assert "holds more than 100000 values, with its aliases (*) written out" in text


def test_on_and_off_are_text_and_exponents_are_numbers(write: Write) -> None:
    folder = write(weather="kind: weather\nid: w\ntime: day\ntitle: on\nair: {mor_m: 2e4}\n")
    (spec,) = compile_library(folder)
    assert (spec.weather.title, spec.weather.air.mor_m) == ("on", 20_000)


def test_a_value_in_one_line_is_marked_as_wide_as_it_is_and_any_other_at_its_start() -> None:
    text = "a: word\nb: {c: 12}\nd: [1, 2]\ne: \"two\n  lines of it\"\nf: ''\n"
    document = parse_document(Path("a.yaml"), text)
    marks = {
        path: (found.line, found.column, found.width)
        for path, found in document.positions.items()
        if path
    }
    assert marks == {
        ("a",): (1, 4, 4),
        ("b",): (2, 4, 1),
        ("b", "c"): (2, 8, 2),
        ("d",): (3, 4, 1),
        ("d", 0): (3, 5, 1),
        ("d", 1): (3, 8, 1),
        ("e",): (4, 4, 1),
        ("f",): (6, 4, 2),
    }

from advercity.compiler.crossing import compile_library
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

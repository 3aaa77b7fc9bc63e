import ast
import os
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import yaml

from advercity.diagnostics import DiagnosticsError
from advercity.documents import parse_json, parse_yaml, read_text

ROOT = Path(__file__).parent.parent
PATH = Path("000060.yaml")
Parse = Callable[[str | bytes, Path], Any]
DEEP = 100_000
ALIASES = "a0: &a0 [x, x, x, x, x, x, x, x, x, x]\n" + "".join(
    f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 10)}]\n" for i in range(1, 9)
)
LADDER = "a0: &a0 [x]\n" + "".join(f"a{i}: &a{i} [*a{i - 1}]\n" for i in range(1, 99))


def refuse(parse: Parse, source: str | bytes) -> str:
    """The message for a text that must be refused within a second of processor time."""
    begin_s = time.process_time()
    with pytest.raises(DiagnosticsError) as caught:
        parse(source, PATH)
    assert time.process_time() - begin_s < 1
    return str(caught.value).splitlines()[0]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[" * DEEP, "1:41: is nested deeper than 40 levels"),
        ("[" * DEEP + "]" * DEEP, "1:41: is nested deeper than 40 levels"),
        ("{a: " * DEEP + "}" * DEEP, "1:161: is nested deeper than 40 levels"),
        ("- " * DEEP + "x", "1:81: is nested deeper than 40 levels"),
        ("? " * DEEP + "x", "1:81: is nested deeper than 40 levels"),
        ("x: 'a'\ny: " + '["]",' * DEEP, "2:199: is nested deeper than 40 levels"),
        (ALIASES, "5:55: holds more than 100000 values, with its aliases (*) written out"),
        (LADDER, "40:12: is nested deeper than 40 levels"),
        ("a: &a [*a]", "1:8: unknown anchor, or one inside itself"),
        ("a: &a {x: 1}\nb: {<<: *a}", "2:5: merge keys (<<) are not supported"),
        ("a: !!python/object/apply:os.system [ls]", "1:4: the tag python/object/apply:os.system"),
        ("speed: 1\nsize: {x: 1, y: 2, x: 3}", "2:20: not valid YAML: duplicate key"),
        ("speed: 1\nspeed: 2", "2:1: not valid YAML: duplicate key"),
        ("a: [1\nb: 2", "1:4: not valid YAML: a list [ is not closed"),
        ("a: 1\nb: \x00", "2:4: unexpected control character"),
        ("a: 1\nb: " + "9" * 5000, "2:4: not valid YAML: '9999999999"),
        ("a: 1\nb: 1" + ":59" * DEEP, "2:4: not valid YAML: '1:59:59"),
        ("a: 1\nb: 1" + ":59" * 999 + ".5", "2:4: not valid YAML: '1:59:59"),
        ("a: 2026-99-99", "1:4: not valid YAML: '2026-99-99' is no number or date"),
        (b"a: 1\nb: \xff", "2:4: is not UTF-8 text"),
        ("a: 1\n".encode("utf-16"), "1:1: is not UTF-8 text"),
    ],
    ids=range(21),
)
def test_harmful_yaml_is_refused_at_once_with_its_place(text: str | bytes, message: str) -> None:
    assert refuse(parse_yaml, text).startswith(f"000060.yaml:{message}")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[" * DEEP, "1:41: not valid JSON: nested deeper than 40 levels"),
        ('{"a":' * DEEP, "1:201: not valid JSON: nested deeper than 40 levels"),
        ('["]",' * DEEP, "1:201: not valid JSON: nested deeper than 40 levels"),
        (r'["\"]",' * DEEP, "1:281: not valid JSON: nested deeper than 40 levels"),
        ('{"a": 1,\n "b": {"a": 2, "b": 3},\n "a": 4}', '3:2: not valid JSON: duplicate key "a"'),
        ('{"a": 1,\n "b": NaN}', "2:7: not valid JSON: NaN is not a number in JSON"),
        ('{"a": -Infinity}', "1:7: not valid JSON: -Infinity is not a number in JSON"),
        ('{"a": ' + "9" * 5000 + "}", "1:7: not valid JSON: a number of 5000 digits"),
        ('{"a": 1,', "1:9: not valid JSON: expecting property name enclosed in double quotes"),
        ('{"a": "\x00"}', "1:8: not valid JSON: invalid control character at"),
        (b'{"a":\n "\xff"}', "2:3: is not UTF-8 text"),
        ("", "1:1: not valid JSON: expecting value"),
    ],
    ids=range(12),
)
def test_harmful_json_is_refused_at_once_with_its_place(text: str | bytes, message: str) -> None:
    assert refuse(parse_json, text).startswith(f"000060.yaml:{message}")


@pytest.mark.parametrize("parse", [parse_yaml, parse_json])
def test_brackets_and_quotes_inside_texts_are_no_nesting(parse: Parse) -> None:
    text = '{"a": "[[[[{{{{ \\" [[[[ \\\\", "b": ["' + "]" * 99 + '", [1, 2.5]], "c": {"d": null}}'
    expected = {"a": '[[[[{{{{ " [[[[ \\', "b": ["]" * 99, [1, 2.5]], "c": {"d": None}}
    assert parse(b"\xef\xbb\xbf" + text.encode(), PATH) == expected


def test_frames_of_other_writers_are_read_as_pyyaml_reads_them() -> None:
    shared = [1.5, -2.0]
    frame = {
        "vehicles": {101: {"location": shared, "center": shared, "color": "255, [0], 0"}},
        "camera0": {"intrinsic": [[1e-9, 0.0, 480.0], [0.0, 335.6, 320.0]]},
        "RSU": False,
        "walkers": {},
    }
    for style in (None, False, True):
        text = yaml.safe_dump(frame, default_flow_style=style)
        assert parse_yaml(text, PATH) == frame
    assert "&id001" in text


@pytest.mark.parametrize("kind", ["pipe", "device", "folder", "huge"])
def test_only_regular_files_of_limited_size_are_read(kind: str, tmp_path: Path) -> None:
    path = tmp_path / "000060.yaml"
    match kind:
        case "pipe":
            os.mkfifo(path)
        case "device":
            path = Path("/dev/zero")
        case "folder":
            path.mkdir()
        case _:
            path.touch()
            os.truncate(path, 1 << 40)
    expected = {"folder": "is a folder", "huge": "is larger than 4 MB"}
    with pytest.raises(DiagnosticsError, match=expected.get(kind, "is not a regular file")):
        read_text(path)


def test_no_other_module_parses_yaml_or_json_of_files() -> None:
    parsers = {"load", "loads", "safe_load", "full_load", "compose", "model_validate_json"}
    parsers |= {"validate_json", "from_json", "safe_load_all", "load_all", "unsafe_load"}
    found: list[str] = []
    for folder in ("advercity", "dsl", "backends/sapien/advercity_sapien"):
        for path in sorted((ROOT / folder).rglob("*.py")):
            for node in ast.walk(ast.parse(path.read_text())):
                if not isinstance(node, ast.Attribute) or node.attr not in parsers:
                    continue
                owner = ast.unparse(node.value)
                if owner in ("yaml", "json") or "json" in node.attr:
                    found.append(f"{path.relative_to(ROOT)}: {ast.unparse(node)}")
    assert set(found) == {
        "advercity/documents.py: json.loads",
        "advercity/documents.py: yaml.load",
    }


ENDLESS = {
    "escapes": '\\"',
    "escaped backslashes": "\\\\",
    "brackets": "[",
    "texts": '"x" ',
    "blanks": " ",
    "digits": "1",
    "signs": "-",
}


@pytest.mark.parametrize("kind", ENDLESS)
def test_the_time_to_refuse_json_grows_with_its_size_and_no_faster(kind: str) -> None:
    def measure_s(count: int) -> float:
        text = f"[{ENDLESS[kind] * count}{'[' * 50}".encode()
        times_s: list[float] = []
        for _ in range(5):
            begin_s = time.process_time()
            with pytest.raises(DiagnosticsError, match="not valid JSON"):
                parse_json(text, Path("x.json"))
            times_s.append(time.process_time() - begin_s)
        return min(times_s)

    # 16 times the size takes 16 times as long, and 256 times if every character is looked at again.
    assert measure_s(320_000) < 64 * max(measure_s(20_000), 1e-3)

import json
import shutil
import subprocess
from collections.abc import Generator, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from advercity_dsl import DECLARATIONS
from advercity_dsl.weather_components import Sun

from advercity.compiler import (
    validate_paths,
)
from advercity.compiler.authoring import (
    SCHEMAS_FOLDER,
    format_starter,
    write_starter,
    write_sun_positions,
)
from advercity.compiler.schema import write_schemas
from advercity.compiler.source import read_document
from advercity.errors import InputError

SERVER = shutil.which("yaml-language-server")


class Client:
    """The least of an editor that a language server talks to."""

    def __init__(self, server: "subprocess.Popen[bytes]") -> None:
        assert server.stdin
        assert server.stdout
        self._to, self._from = server.stdin, server.stdout
        self._number = 0

    def tell(self, method: str, **params: Any) -> None:
        self._send({"method": method, "params": params})

    def ask(self, method: str, **params: Any) -> Any:
        self._number += 1
        number = self._number
        self._send({"id": number, "method": method, "params": params})
        return next(item["result"] for item in self._messages() if item.get("id") == number)

    def diagnostics(self) -> list[str]:
        name = "textDocument/publishDiagnostics"
        found = next(item["params"] for item in self._messages() if item.get("method") == name)
        return [item["message"] for item in found["diagnostics"]]

    def _send(self, message: dict[str, Any]) -> None:
        body = json.dumps({"jsonrpc": "2.0", **message}).encode()
        self._to.write(b"Content-Length: %d\r\n\r\n%b" % (len(body), body))
        self._to.flush()

    def _messages(self) -> Iterator[dict[str, Any]]:
        while header := self._from.readline():
            length = int(header.removeprefix(b"Content-Length: "))
            self._from.readline()
            message = json.loads(self._from.read(length))
            if "method" in message and "id" in message:
                asked = message["params"].get("items", [])
                answer = (
                    [{} for _ in asked] if message["method"].endswith("configuration") else None
                )
                self._send({"id": message["id"], "result": answer})
            else:
                yield message


@contextmanager
def opened(path: Path, text: str) -> Generator[Client]:
    """A language server that has a file open, with `text` in place of what the file holds."""
    assert SERVER
    with subprocess.Popen(
        [SERVER, "--stdio"], stdin=subprocess.PIPE, stdout=subprocess.PIPE
    ) as server:
        client = Client(server)
        folder = path.parent.as_uri()
        client.ask("initialize", processId=None, rootUri=folder, capabilities={})
        client.tell("initialized")
        settings = {"yaml": {"hover": True, "completion": True, "validate": True}}
        client.tell("workspace/didChangeConfiguration", settings=settings)
        document = {"uri": path.as_uri(), "languageId": "yaml", "version": 1, "text": text}
        client.tell("textDocument/didOpen", textDocument=document)
        yield client
        server.terminate()


@pytest.mark.parametrize("kind", DECLARATIONS)
def test_a_starter_is_valid_and_never_overwrites(kind: str, tmp_path: Path) -> None:
    path = write_starter(kind, "mine", tmp_path)
    validate_paths(path)
    assert (tmp_path / ".advercity" / f"{kind}.schema.json").is_file()
    assert path.read_text().splitlines()[0].startswith("# yaml-language-server: $schema=")
    with pytest.raises(InputError, match="already exists"):
        write_starter(kind, "mine", tmp_path)


def test_a_name_that_is_not_an_id_is_rejected() -> None:
    with pytest.raises(InputError, match=r"'\.\./x' is not an id"):
        format_starter("weather", "../x")


@pytest.mark.parametrize("name", ["null", "true", "false"])
def test_a_name_that_yaml_reads_as_a_value_is_rejected(name: str) -> None:
    with pytest.raises(InputError, match=f"'{name}' is a value in YAML, not a text"):
        format_starter("weather", name)


def test_files_of_the_library_refer_to_their_schemas(library: Path, tmp_path: Path) -> None:
    write_schemas(tmp_path / SCHEMAS_FOLDER)
    shutil.copytree(library, tmp_path, dirs_exist_ok=True, ignore=shutil.ignore_patterns(".*"))
    named = 0
    for path in tmp_path.rglob("*.yaml"):
        mark, _, schema = path.read_text().splitlines()[0].partition("$schema=")
        if mark == "# yaml-language-server: ":
            kind = read_document(path).data["kind"]
            fields = json.loads((path.parent / schema).read_text())["properties"]
            assert fields["kind"]["const"] == kind
            named += 1
    assert named >= 30


@pytest.mark.skipif(
    SERVER is None,
    reason="schemas are not tested in an editor; `npm install -g yaml-language-server` helps",
)
def test_an_editor_checks_explains_and_completes(tmp_path: Path) -> None:
    path = write_starter("weather", "mine", tmp_path)
    lines = path.read_text().splitlines()
    with opened(path, "\n".join(lines)) as editor:
        assert editor.diagnostics() == []
        at = next(number for number, line in enumerate(lines) if line.startswith("snow:")) + 1
        uri = {"uri": path.as_uri()}
        hover = editor.ask(
            "textDocument/hover", textDocument=uri, position={"line": at, "character": 4}
        )
        assert "Liquid equivalent" in str(hover)
    spoilt = [line.replace("rate_mm_h: 1 mm/h", "rate_mm_h: 400") for line in lines]
    with opened(path, "\n".join([*spoilt, "umbrella: 3", "lens: {", "  "])) as editor:
        said = " ".join(editor.diagnostics())
        assert "maximum of 10" in said
        assert "umbrella" in said
    with opened(path, "\n".join([*lines, "lens:", "  "])) as editor:
        position = {"line": len(lines) + 1, "character": 2}
        offered = editor.ask("textDocument/completion", textDocument=uri, position=position)
        assert {"enabled", "kind", "coverage"} <= {item["label"] for item in offered["items"]}


SUNS = {"ui": Sun(elevation_deg=7, azimuth_deg=180), "ri": Sun(elevation_deg=5.5, azimuth_deg=92)}
SUN_AT = (
    "sun_at:  # found by `advercity solve`|"
    "  ui: {elevation_deg: 7, azimuth_deg: 180}|  ri: {elevation_deg: 5.5, azimuth_deg: 92}|"
)


NO_SUNS = "sun_at:  # found by `advercity solve`|"
WRITTEN_BY_HAND = "sun_at:  # mine|    # measured|    unj: {elevation_deg: 1}  # on 3 May|"
ADDED = (
    "    ui: {elevation_deg: 7, azimuth_deg: 180}|    ri: {elevation_deg: 5.5, azimuth_deg: 92}|"
)


@pytest.mark.parametrize("newline", ["\n", "\r\n"])
@pytest.mark.parametrize(
    ("former", "expected"),
    [
        ("", SUN_AT),
        (NO_SUNS, SUN_AT),
        (WRITTEN_BY_HAND, WRITTEN_BY_HAND + ADDED),
    ],
)
def test_solved_suns_follow_the_sun_and_leave_all_other_lines_as_they_are(
    tmp_path: Path, former: str, expected: str, newline: str
) -> None:
    path = tmp_path / "glare.yaml"
    before, after = (
        "# mine|kind: weather|sun:|  elevation_deg: 5|",
        "sky: {oktas: 0}  # kept|",
    )
    path.write_bytes(f"{before}{former}{after}".replace("|", newline).encode())
    write_sun_positions(path, SUNS)
    assert path.read_bytes() == f"{before}{expected}{after}".replace("|", newline).encode()


@pytest.mark.parametrize(
    "written", ["sun_at: {unj: {elevation_deg: 1}}", "sun_at:\n  ui: {elevation_deg: 1}  # mine"]
)
def test_suns_that_cannot_be_added_leave_the_file_as_it_is(tmp_path: Path, written: str) -> None:
    path = tmp_path / "glare.yaml"
    content = f"kind: weather\nsun: {{in_view_of: ego}}\n{written}\n"
    path.write_text(content)
    with pytest.raises(InputError, match=r"glare\.yaml"):
        write_sun_positions(path, SUNS)
    assert path.read_text() == content


def test_suns_of_a_weather_without_one_of_its_own_are_shown_and_not_written(
    tmp_path: Path,
) -> None:
    path = tmp_path / "glare.yaml"
    path.write_text("{kind: weather, sun: {elevation_deg: 5}}\n")
    with pytest.raises(
        InputError, match=r"`sun` or `sun_at` does not .* write: sun_at: \{ui: \{el"
    ):
        write_sun_positions(path, SUNS)
    assert path.read_text() == "{kind: weather, sun: {elevation_deg: 5}}\n"

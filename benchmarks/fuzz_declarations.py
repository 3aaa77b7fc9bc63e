"""Damages declarations and specs at random: each must be read, or rejected with a message.

python benchmarks/fuzz_declarations.py [COUNT] [SEED]
"""

import shutil
import signal
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Generator, Sequence
from contextlib import contextmanager
from pathlib import Path
from types import FrameType

import numpy as np

from advercity.compiler import read_spec, validate_paths, write_specs
from advercity.compiler.crossing import compile_library
from advercity.errors import InputError
from advercity.randomness import create_generator

ROOT = Path(__file__).parent.parent
SMALL_LIBRARY = ROOT / "tests" / "compiler" / "base"
LIMIT_S = 10
"""Limit of processor time, which does not depend on how busy the machine is."""
ODD_VALUES = (
    *("null", "true", "off", "0", "-1", "1e999", "-0.0", "9" * 400, ".inf", "[]", "{}", "''"),
    *("[1, [2, [3]]]", "{a: {b: 1}}", "75 m", "3 parsecs", "*a", "&a x", "!!int 3", "../../etc"),
    *("{uniform: [1, 2]}", "{uniform: [2, x]}", "{choice: []}", "{normal: {mean: 1, sd: 0}}"),
    *("{normal: {mean: 80, sd: 1e-9, within: [10, 90]}}", "\u202e", "\U0001f327", "<<", "all"),
)
ODD_LINES = (
    *("extends: nothing", "extends: [a, b]", "  - ", "\t", "---", "...", "%YAML 9", "? x", ": y"),
    *("sweep: {field: weather.fog.mor_m, from: 1 km, to: 20 m, count: 5, log: true}",),
    *("sweep: {field: road.id, values: [1]}", "sweep: {field: weather.sun_at.x, values: [1]}"),
    *("where: {weather.fog.mor_m: {at_least: x}}", "where: {density.vehicles: [1, 2]}", "\x00"),
    *("where: {weather.fog.mor_m.x: 3}", "where: {weather.fog: null, road.streets.main: 1}"),
    *("sweep: {field: road.streets.main.path.0.line_m, values: [150, 1 km]}",),
    *("sweep: {field: road.streets.main.path.7.line_m, values: [150]}",),
    *("sweep: {field: density.vehicles, values: [0, 1e9]}", "fog: {mor_m: {uniform: [10, 1 km]}}"),
)


class MutationTimeoutError(Exception):
    """A damaged file kept the compiler busy."""


def mutate(text: str, rng: np.random.Generator) -> bytes:
    """Return the text with one to four damages, as bytes that may not even be UTF-8."""
    for _ in range(int(rng.integers(1, 5))):
        text = _apply_damage(text, rng)
    raw = text.encode("utf-8", "surrogatepass")
    if rng.random() < 0.05 and raw:
        at = int(rng.integers(len(raw)))
        raw = raw[:at] + bytes([int(rng.integers(256))]) + raw[at + 1 :]
    return raw


def _apply_damage(text: str, rng: np.random.Generator) -> str:
    lines = text.split("\n")
    at = int(rng.integers(len(lines)))
    other = int(rng.integers(len(lines)))
    match int(rng.integers(9)):
        case 0:
            lines[at] = ""
        case 1:
            lines.insert(other, lines[at])
        case 2:
            lines[at], lines[other] = lines[other], lines[at]
        case 3:
            lines[at] = " " * int(rng.integers(5)) + lines[at].lstrip()
        case 4:
            lines.insert(at, _choose(ODD_LINES, rng))
        case 5:
            return text[: int(rng.integers(len(text) + 1))]
        case 6:
            begin = int(rng.integers(len(text) + 1))
            return text[:begin] + _choose(list("{}[]:,#&*!|>'\"%@`- \t\r\n0x"), rng) + text[begin:]
        case 7:
            begin = int(rng.integers(len(text) + 1))
            return text[:begin] + text[begin + int(rng.integers(1, 8)) :]
        case _:
            key, colon, _ = lines[at].partition(":")
            lines[at] = f"{key}{colon} {_choose(ODD_VALUES, rng)}"
    return "\n".join(lines)


def _choose(choices: Sequence[str], rng: np.random.Generator) -> str:
    return choices[int(rng.integers(len(choices)))]


@contextmanager
def time_limit() -> Generator[None]:
    """Raise after LIMIT_S of processor time."""

    def stop(number: int, frame: FrameType | None) -> None:
        raise MutationTimeoutError

    before = signal.signal(signal.SIGPROF, stop)
    signal.setitimer(signal.ITIMER_PROF, LIMIT_S)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
        signal.signal(signal.SIGPROF, before)


def check_mutation(number: int, seed: int, folder: Path) -> str:
    """Damage one file and read it: `read` or `rejected`; anything else is raised.

    Args:
        number: Number of the mutation; with `seed` it decides everything.
        seed: Seed of the series.
        folder: An empty folder to work in.
    """
    rng = create_generator(seed, "mutation", number)
    with time_limit():
        match int(rng.integers(4)):
            case 0:
                return _check_library(rng, folder)
            case 1:
                shipped = sorted((ROOT / "library").rglob("*.yaml"))
                return _check_file(shipped[int(rng.integers(len(shipped)))], rng, folder)
            case 2:
                specs = sorted((ROOT / "compiled").glob("*.json"))
                return _check_file(specs[int(rng.integers(len(specs)))], rng, folder)
            case _:
                return _check_library(rng, folder, only="suite")


def _check_library(rng: np.random.Generator, folder: Path, only: str = "*") -> str:
    library, output = folder / "library", folder / "output"
    shutil.copytree(SMALL_LIBRARY, library)
    files = sorted(library.glob(f"{only}.yaml"))
    path = files[int(rng.integers(len(files)))]
    path.write_bytes(mutate(path.read_text(), rng))
    before = {item for item in folder.rglob("*") if item.is_file()}
    try:
        write_specs(compile_library(library), output)
    except InputError as error:
        assert str(error).strip(), "empty message"
        assert not output.exists(), "partial output is left"
        return "rejected"
    for spec in output.glob("*.json"):
        read_spec(spec)
    new = {item for item in folder.rglob("*") if item.is_file()} - before
    assert all(item.parent == output for item in new), f"files elsewhere: {new}"
    return "read"


def _check_file(original: Path, rng: np.random.Generator, folder: Path) -> str:
    path = folder / original.name
    path.write_bytes(mutate(original.read_text(), rng))
    try:
        validate_paths(path)
    except InputError as error:
        assert str(error).startswith(str(folder)), f"no file in the message: {error}"
        return "rejected"
    return "read"


def main() -> int:
    """Damage many files, and print those that fail with their numbers."""
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 10_000
    seed = int(sys.argv[2]) if len(sys.argv) > 2 else 1
    outcomes: Counter[str] = Counter()
    begin = time.perf_counter()
    failed = 0
    for number in range(count):
        with tempfile.TemporaryDirectory() as folder:
            try:
                outcomes[check_mutation(number, seed, Path(folder))] += 1
            except Exception as error:
                failed += 1
                print(f"{number}: {type(error).__name__}: {str(error)[:300]}")
    wall_s = time.perf_counter() - begin
    print(f"{count} in {wall_s:.0f} s: {dict(outcomes)}, {failed} failed")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())

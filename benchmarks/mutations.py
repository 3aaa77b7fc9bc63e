"""Damages of files, drawn at random: of text, of any bytes, of arrays; and the limit of time."""

import io
import re
import signal
import zipfile
from collections.abc import Generator, Sequence
from contextlib import contextmanager
from types import FrameType
from typing import TypeVar

import numpy as np

T = TypeVar("T")
LIMIT_S = 10
"""Limit of processor time, which does not depend on how busy the machine is."""
WAITING_LIMIT_S = 300
"""Limit of time for what waits, such as for the other end of a pipe."""
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
    """A damaged file kept its reader busy."""


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
            lines.insert(at, choose(ODD_LINES, rng))
        case 5:
            return text[: int(rng.integers(len(text) + 1))]
        case 6:
            begin = int(rng.integers(len(text) + 1))
            return text[:begin] + choose(list("{}[]:,#&*!|>'\"%@`- \t\r\n0x"), rng) + text[begin:]
        case 7:
            begin = int(rng.integers(len(text) + 1))
            return text[:begin] + text[begin + int(rng.integers(1, 8)) :]
        case _:
            key, colon, _ = lines[at].partition(":")
            lines[at] = f"{key}{colon} {choose(ODD_VALUES, rng)}"
    return "\n".join(lines)


ODD_ATTRIBUTES = (
    *(
        "",
        "nan",
        "inf",
        "-1",
        "0",
        "1",
        "1e308",
        "-1e-320",
        "9" * 400,
        "٣",
        "²",
        "1_0",
        " 5 ",
        "0x1",
    ),
    *("true", "a b", "-1 2", "../../etc/passwd", "%s", "&#x202e;", "1,2 3,4", "none", ":", "#"),
)


def damage_attributes(text: str, rng: np.random.Generator) -> str:
    """Return XML with odd values of one to four attributes, or with an element more or less."""
    for _ in range(int(rng.integers(1, 5))):
        pattern = r"<\w[^<>]*/>" if rng.random() < 0.2 else r'(?<==")[^"<>]*(?=")'
        found = [one.span() for one in re.finditer(pattern, text)]
        if not found:
            continue
        (begin, end), (first, last) = choose(found, rng), choose(found, rng)
        other = text[first:last] if rng.random() < 0.3 else ""
        if pattern[0] != "<":
            other = other or choose(ODD_ATTRIBUTES, rng)
        text = text[:begin] + other + text[end:]
    return text


def choose(choices: Sequence[T], rng: np.random.Generator) -> T:
    """Return one of the choices."""
    return choices[int(rng.integers(len(choices)))]


@contextmanager
def time_limit() -> Generator[None]:
    """Raise after LIMIT_S of processor time, or WAITING_LIMIT_S of any."""

    def stop(number: int, frame: FrameType | None) -> None:
        raise MutationTimeoutError

    timers = [
        (signal.SIGPROF, signal.ITIMER_PROF, LIMIT_S),
        (signal.SIGALRM, signal.ITIMER_REAL, WAITING_LIMIT_S),
    ]
    before = [signal.signal(number, stop) for number, _, _ in timers]
    for _, timer, limit_s in timers:
        signal.setitimer(timer, limit_s)
    try:
        yield
    finally:
        for (number, timer, _), handler in zip(timers, before, strict=True):
            signal.setitimer(timer, 0)
            signal.signal(number, handler)


ODD_BYTES = (
    *(b"", b"\0" * 64, b"\xff\xfe", b"[" * 100_000, b"{" * 100_000, b'{"a":' * 100_000),
    *(b"- " * 50_000, b"? " * 50_000, b"&a [*a]", b"<<: *a", b"!!python/none x", b"NaN"),
    *(b"1e999", b"9" * 5000, b"null", b"[]", b"{}", b'""', b"-1", b"2026-99-99", b"1:59" * 999),
)


def damage_bytes(raw: bytes, rng: np.random.Generator) -> bytes:
    """Return the bytes with one to four damages."""
    for _ in range(int(rng.integers(1, 5))):
        begin, end = sorted(int(at) for at in rng.integers(len(raw) + 1, size=2))
        short = min(end, begin + int(rng.integers(1, 9)))
        odd = ODD_BYTES[int(rng.integers(len(ODD_BYTES)))]
        match int(rng.integers(6)):
            case 0:
                raw = raw[:begin]
            case 1:
                raw = raw[:begin] + odd + raw[short:]
            case 2:
                raw = raw[:begin] + rng.bytes(short - begin) + raw[short:]
            case 3:
                raw = raw[:begin] + raw[short:]
            case 4:
                raw = raw[:end] + raw[begin:end] + raw[end:]
            case _:
                raw = raw[:begin] + bytes(end - begin) + raw[end:]
    return raw


ODD_NUMBERS = (0, -1, 1, 255, 2**31 - 1, -(2**31), 1e-300, 1e30, -1e308, np.nan, np.inf)


def damage_arrays(raw: bytes, rng: np.random.Generator) -> bytes:
    """Return an `.npz` file with a damage behind right checksums: to an array, or its name."""
    with zipfile.ZipFile(io.BytesIO(raw)) as archive:
        files = {name: archive.read(name) for name in archive.namelist()}
    names = sorted(files)
    name, other = choose(names, rng), choose(names, rng)
    match int(rng.integers(6)):
        case 0:
            del files[name]
        case 1:
            files[name] = files[other]
        case 2:
            files[name] = damage_bytes(files[name], rng)
        case 3:
            head, rest = files[name][:128], files[name][128:]
            files[name] = mutate(head.decode("latin-1"), rng) + rest
        case _:
            files[name] = _damage_array(files[name], rng)
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w") as archive:
        for name, content in files.items():
            archive.writestr(name, content)
    return stream.getvalue()


def _damage_array(raw: bytes, rng: np.random.Generator) -> bytes:
    """Return an `.npy` file with other values: odd numbers, other lengths, or other JSON."""
    array = np.load(io.BytesIO(raw))
    if array.dtype == np.uint8 and array.ndim == 1:
        array = np.frombuffer(mutate(array.tobytes().decode(), rng), np.uint8)
    elif array.dtype.kind in "iuf" and array.size:
        flat = array.ravel()
        with np.errstate(all="ignore"):
            value = np.array(ODD_NUMBERS[int(rng.integers(len(ODD_NUMBERS)))]).astype(array.dtype)
        flat[rng.integers(flat.size, size=int(rng.integers(1, 4)))] = value
        array = flat.reshape(array.shape)
    elif array.ndim:
        array = array[: int(rng.integers(len(array) + 1))]
    stream = io.BytesIO()
    np.save(stream, array)
    return stream.getvalue()

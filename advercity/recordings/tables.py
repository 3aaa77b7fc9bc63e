"""Tables of others, CSV or Parquet, with the place of every value for messages."""

import csv
import importlib
import math
import re
from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
from advercity_dsl.base import suggest_name
from numpy.typing import NDArray

from advercity.diagnostics import Diagnostic, DiagnosticsError
from advercity.documents import read_bytes, read_text
from advercity.errors import InputError

MAX_TABLE_BYTES = 1_000_000_000
MAX_ROWS = 20_000_000
PARQUET_SUFFIXES = (".parquet", ".pq")
_LINE_END = re.compile(r"[\r\n]")
"""Ends of lines, also of old Macintosh systems."""


@dataclass(frozen=True, eq=False)
class Table:
    """Columns of text, by the names in the head.

    Attributes:
        path: The file.
        columns: Requested columns of the file, blank without a value.
        head: Names of all columns of the file.
        lines: Line of every row; none of a Parquet file, which has no lines.
        text: Content of a CSV file.
    """

    path: Path
    columns: dict[str, list[str]]
    head: Sequence[str]
    lines: Sequence[int]
    text: str = ""

    def __len__(self) -> int:
        """Return the number of rows."""
        return len(next(iter(self.columns.values()), ()))

    def parse_numbers(self, name: str, *, blank: float | None = None) -> NDArray[np.float64]:
        """Parse a column (n,); `blank`, if given, is the number where there is no value.

        Raises:
            DiagnosticsError: A value is not a finite number.
        """
        column = self.columns[name]
        fallback = None if blank is None else str(blank)
        try:
            numbers = np.array([float(text or fallback or text) for text in column])
        except ValueError:
            numbers = np.array([_parse_number(text or fallback or text) for text in column])
        given = np.array([bool(text) or fallback is None for text in column], dtype=bool)
        wrong = np.flatnonzero(~np.isfinite(numbers) & given)
        if len(wrong):
            row = int(wrong[0])
            found = f"'{column[row][:40]}'" if column[row] else "a blank"
            raise self.build_error(row, name, f"{found} is not a number", "write it as 12.5")
        return numbers

    def build_error(
        self, row: int, name: str, message: str, hint: str = "", *, path: Path | None = None
    ) -> DiagnosticsError:
        """Build an error at the value of a row, counted from 0, in a column."""
        if not self.lines:
            value_path = f"row {row + 1}, {name}"
            return DiagnosticsError(Diagnostic(self.path, 0, 0, value_path, message, hint))
        line = self.lines[row]
        text = next(islice(self.text.splitlines(), line - 1, None), "")
        column, width = _locate_field(text, list(self.head).index(name))
        return DiagnosticsError(
            Diagnostic(self.path, line, column, name, message, hint, text, width)
        )


def _parse_number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        return math.nan


def _locate_field(line: str, index: int) -> tuple[int, int]:
    """Find column (from 1) and width of a field of a line, without quotes in the fields before."""
    separator = ";" if ";" in line and "," not in line else ","
    fields = line.split(separator)
    if '"' in line or index >= len(fields):
        return 1, 1
    return sum(len(field) + 1 for field in fields[:index]) + 1, max(len(fields[index]), 1)


def read_head(path: Path) -> list[str]:
    """Read the names of a table's columns.

    Raises:
        InputError: It cannot be read, or is no table.
    """
    if path.suffix in PARQUET_SUFFIXES:
        return list(_open_parquet(path).schema_arrow.names)
    text = read_text(path, max_bytes=MAX_TABLE_BYTES)
    end = _LINE_END.search(text)
    return _split_head(path, text[: end.start()] if end else text)


def _split_head(path: Path, line: str) -> list[str]:
    separator = ";" if ";" in line and "," not in line else ","
    try:
        return [name.strip() for name in next(csv.reader([line], delimiter=separator), [])]
    except csv.Error as error:
        raise DiagnosticsError(Diagnostic(path, 1, 1, "", f"is not CSV: {error}")) from None


def read_table(path: Path, required: Iterable[str], optional: Collection[str] = ()) -> Table:
    """Read some columns of a table.

    Raises:
        InputError: It cannot be read, is no table, or lacks a column.
    """
    if path.suffix not in PARQUET_SUFFIXES:
        return parse_csv(path, read_text(path, max_bytes=MAX_TABLE_BYTES), required, optional)
    file = _open_parquet(path)
    if file.metadata.num_rows > MAX_ROWS:
        raise InputError(f"{path}: has {file.metadata.num_rows} rows; at most {MAX_ROWS} are read")
    head = list(file.schema_arrow.names)
    wanted = _select_columns(path, head, required, optional)
    try:
        found = file.read(columns=wanted).to_pydict()
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: is damaged: {error}") from None
    columns = {
        name: ["" if value is None else str(value) for value in found[name]] for name in wanted
    }
    return _check_rows(Table(path, columns, head, ()))


def _select_columns(
    path: Path, head: Sequence[str], required: Iterable[str], optional: Collection[str]
) -> list[str]:
    required = list(required)
    missing = [name for name in required if name not in head]
    if missing:
        message = f"has no column '{missing[0]}'; {suggest_name(missing[0], head)}"
        raise DiagnosticsError(Diagnostic(path, 1, 1, "", message))
    return [*required, *(name for name in optional if name in head)]


def _check_rows(table: Table) -> Table:
    if not len(table):
        raise DiagnosticsError(Diagnostic(table.path, 0, 0, "", "has no rows below its head"))
    return table


def parse_csv(
    path: Path, text: str, required: Iterable[str], optional: Collection[str] = ()
) -> Table:
    """Parse some columns of the CSV text of the file `path`.

    Raises:
        DiagnosticsError: It is no CSV, or lacks a column.
    """
    # Without their ends, a quoted value on two lines would be joined to another value.
    lines = text.splitlines(keepends=True) or [""]
    head = _split_head(path, lines[0])
    wanted = _select_columns(path, head, required, optional)
    separator = ";" if ";" in lines[0] and "," not in lines[0] else ","
    reader = csv.reader(lines, delimiter=separator, strict=True)
    places = [head.index(name) for name in wanted]
    columns: list[list[str]] = [[] for _ in wanted]
    numbers: list[int] = []
    ended = 0
    try:
        next(reader)
        ended = reader.line_num
        for row in reader:
            number, ended = ended + 1, reader.line_num
            if not row:
                continue
            message = hint = ""
            if len(row) != len(head):
                message = f"has {len(row)} values below {len(head)} names of columns"
            elif ended > number and any(len(row[at].strip().splitlines()) > 1 for at in places):
                message, hint = "has a value with a line break", "write every value on one line"
            if message:
                line = lines[number - 1].rstrip()
                found = Diagnostic(path, number, 1, "", message, hint, line, len(line))
                raise DiagnosticsError(found)
            numbers.append(number)
            for column, place in zip(columns, places, strict=True):
                column.append(row[place].strip())
    except csv.Error as error:
        # An open quote takes the lines below it for one value.
        line = lines[ended].rstrip()
        place = ended + 1, line.rfind('"') + 1 if line.count('"') % 2 else 1
        message = f"is not CSV: {error}"
        raise DiagnosticsError(Diagnostic(path, *place, "", message, "", line)) from None
    return _check_rows(Table(path, dict(zip(wanted, columns, strict=True)), head, numbers, text))


def _open_parquet(path: Path) -> Any:
    try:
        parquet = importlib.import_module("pyarrow.parquet")
    except ImportError:
        raise InputError(
            f"{path}: Parquet is read by PyArrow, which is not installed;"
            " `pip install advercity[parquet]`, or write the table as CSV"
        ) from None
    read_bytes(path, max_bytes=MAX_TABLE_BYTES)
    try:
        return parquet.ParquetFile(path)
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: is not a Parquet file: {error}") from None

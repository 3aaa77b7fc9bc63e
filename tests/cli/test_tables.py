"""Tables of commands."""

from advercity.cli.tables import format_columns


def test_a_wide_table_fits_a_terminal_in_parts_with_the_first_column_each() -> None:
    heads = [f"some head {number}" for number in range(12)]
    rows = [{"scenario": name, **dict.fromkeys(heads, number)} for name, number in (("a", 7),) * 2]
    parts = [part.splitlines() for part in format_columns(rows, max_width=100).split("\n\n")]
    assert [len(part) for part in parts] == [3, 3]
    assert max(len(line) for part in parts for line in part) <= 100
    assert all(part[0].startswith("scenario  some head") for part in parts)
    assert sum(part[0].count("some head") for part in parts) == 12


def test_columns_empty_in_every_row_are_left_out() -> None:
    rows = [{"name": "a", "gap s": "", "outside": ""}, {"name": "b", "gap s": 1.5, "outside": ""}]
    assert format_columns(rows).splitlines()[0] == "name  gap s"

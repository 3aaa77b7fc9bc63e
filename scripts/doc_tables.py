#!/usr/bin/env python
"""Make the tables of traffic in pages of docs again: `scripts/doc_tables.py docs/scenarios.md ...`.

Such a table follows a code block whose last command has `--markdown`. The commands run in an empty
folder that links to the repository's library and specs, and the table becomes what they print.
"""

import re
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
BLOCK = re.compile(
    r"^```\n(?P<command>(?:[^`\n]*\n)*[^`\n]*--markdown)\n```\n\n(?P<table>(?:\|.*\n)+)", re.M
)


def make_table(command: str) -> str:
    """Run the commands of a code block and return the table that they print."""
    with tempfile.TemporaryDirectory() as folder:
        for name in ("library", "compiled"):
            (Path(folder) / name).symlink_to(ROOT / name)
        run = ["bash", "-e", "-c", command]
        done = subprocess.run(run, cwd=folder, capture_output=True, text=True, check=True)  # noqa: S603
    return "".join(line for line in done.stdout.splitlines(True) if line.startswith("|"))


def renew(page: Path) -> None:
    """Replace the tables of a page."""
    text = page.read_text()
    for block in reversed(list(BLOCK.finditer(text))):
        text = text[: block.start("table")] + make_table(block["command"]) + text[block.end() :]
    page.write_text(text)


if __name__ == "__main__":
    for argument in sys.argv[1:]:
        renew(Path(argument))

"""Runs a notebook's cells, as a reader of exports would.

python read_notebook.py NOTEBOOK
"""

import contextlib
import io
import json
import sys
from pathlib import Path
from typing import Any

import matplotlib as mpl

mpl.use("Agg")
import matplotlib.pyplot as plt

names: dict[str, Any] = {}
printed = io.StringIO()
with contextlib.redirect_stdout(printed):
    for cell in json.loads(Path(sys.argv[1]).read_text())["cells"]:
        if cell["cell_type"] == "code":
            assert not cell["outputs"]
            exec("".join(cell["source"]), names)
print(json.dumps({"figures": len(plt.get_fignums()), "lines": printed.getvalue().splitlines()}))

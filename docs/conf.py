"""How the site is built: `sphinx-build -W -n docs build/docs`."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))

from make_reference import write_reference

from advercity import __version__

project = "advercity"
version = release = __version__
extensions = ["myst_parser"]
html_theme = "furo"
html_title = "advercity"
exclude_patterns = ["images", "**/__pycache__"]
myst_heading_anchors = 3

write_reference(Path(__file__).parent / "reference")

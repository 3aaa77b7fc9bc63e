"""How the site is built: `sphinx-build -W -n docs build/docs`."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))

from make_reference import write_reference

from advercity import __version__

project = "advercity"
version = release = __version__
extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
html_theme = "furo"
html_title = "advercity"
exclude_patterns = ["images", "**/__pycache__"]
myst_heading_anchors = 3
autodoc_member_order = "bysource"
autodoc_typehints = "signature"
autodoc_preserve_defaults = True
# Types of NumPy and pydantic are named, whose sites cannot be reached while building.
nitpick_ignore_regex = [("py:.*", ".*")]

write_reference(Path(__file__).parent / "reference")

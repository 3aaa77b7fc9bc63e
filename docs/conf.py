"""How the site is built: `sphinx-build -W -n docs build/docs`."""

import re
import sys
from pathlib import Path
from typing import Any

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


LINK_TO_SOURCE = re.compile(r"\[(\w+)\]\(\.\./\.\./[\w/]+\.py\)")
"""A link of a guide to the module that declares something; a clone has no other reference."""


def link_reference(app: Any, page: str, source: list[str]) -> None:
    """Let links to modules lead to the page of the reference that is made from them."""
    source[0] = LINK_TO_SOURCE.sub(r"[\1](../reference/\1.md)", source[0])


def setup(app: Any) -> None:
    """Register with Sphinx."""
    app.connect("source-read", link_reference)

"""Sphinx configuration; `make docs` builds the site without a network."""

from __future__ import annotations

import logging
import os
import sys
from pathlib import Path
from typing import Any

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE))
logging.getLogger("traitlets").setLevel(logging.WARNING)  # no word on every notebook that is run

import pages  # noqa: E402

import planner  # noqa: E402

project = "planner"
author = "the planner authors"
copyright = "2026, the planner authors"
release = version = planner.__version__

extensions = [
    "myst_nb",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "sphinx.ext.mathjax",
    "sphinx-mathjax-offline",
]
exclude_patterns = ["problems"]
html_theme = "furo"
html_title = "planner"
html_static_path = ["_static"]
html_css_files = ["output.css"]

autodoc_member_order = "bysource"
autodoc_typehints = "signature"
autodoc_preserve_defaults = True
autodoc_type_aliases = {"ArrayLike": "ArrayLike", "Array": "Array"}
python_maximum_signature_line_length = 88
napoleon_google_docstring = True
napoleon_numpy_docstring = False
napoleon_use_ivar = True
napoleon_use_rtype = False
default_role = "code"

myst_enable_extensions = ["dollarmath", "amsmath", "colon_fence", "deflist"]
myst_heading_anchors = 3
nb_execution_mode = os.environ.get("PLANNER_DOCS_NOTEBOOKS", "cache")  # "off": quickly, no outputs
nb_execution_cache_path = str(HERE.parent / "out" / "docs-cache")
nb_execution_timeout = 120
nb_execution_raise_on_error = True
nb_merge_streams = True
nb_ipywidgets_js: dict[str, dict[str, str]] = {}  # nothing from a network; a widget shows its text


def plain_marks(app: Any, what: str, name: str, thing: Any, options: Any, lines: list[str]) -> None:
    """Docstrings are plain text with `code`: a bar or a star in them is that, and no markup."""
    for k, line in enumerate(lines):
        lines[k] = pages.escaped(line)


def link_copies(app: Any, name: str, source: list[str]) -> None:
    """Links to notebooks are those of the repository; the site has copies inside this folder."""
    source[0] = source[0].replace("](../../notebooks/", "](../notebooks/")
    if "/" not in name:
        source[0] = source[0].replace("](../notebooks/", "](notebooks/")


def setup(app: Any) -> None:
    """Copy what lies outside this folder, then build."""
    pages.copy_sources(HERE)
    app.connect("source-read", link_copies)
    app.connect("autodoc-process-docstring", plain_marks, priority=900)

"""The installed package: its name on the index, its version, and how to add an extra.

What results return, and the code that draws and writes them, is imported on use: annotations
name `Figure`, `Table`, `DataFrame` and `Dataset`; `import_function` and `draw_figure` find code of
packages above.
"""

from __future__ import annotations

import importlib
import platform
import shlex
import subprocess
import tomllib
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Figure
    from pandas import DataFrame as DataFrame
    from rich.table import Table as Table
    from xarray import Dataset as Dataset

    __version__: str
else:
    Figure = Table = DataFrame = Dataset = Any  # slow to import, and named in annotations only

    def __getattr__(name: str) -> str:
        """Return `__version__`, looked up on access because that reads a file or imports slowly."""
        if name == "__version__":
            return version()
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def import_function(function: str) -> Callable[..., Any]:
    """Import a function by its full name, where a normal import would be circular.

    Only results that return tables, pictures and folders use this: the modules that draw and write
    them import the results.
    """
    module, _, name = function.rpartition(".")
    imported: Callable[..., Any] = getattr(importlib.import_module(module), name)
    return imported


def draw_figure(function: str, *results: Any) -> Figure:
    """Draw results by a function of a module in `planner.report.figures` ("over_time.plot")."""
    module, name = function.split(".")
    draw = getattr(importlib.import_module(f"planner.report.figures.{module}"), name)
    figure: Figure = draw(*results)[0]
    return figure


NAME = "nonholonomic-planner"
"""Name of this package on the package index, where `planner` is another package."""

ROOT = Path(__file__).parents[2]


def version() -> str:
    """Return the version in a checkout's pyproject.toml, else that of the installed package.

    An editable install keeps the version of the day it was installed, so the file comes first.
    """
    if checkout := _checkout():
        return checkout
    from importlib import metadata  # slow to import

    try:
        return metadata.version(NAME)
    except metadata.PackageNotFoundError:  # copied, not installed
        return "unknown"


@cache
def release() -> str:
    """Return the name of the version for pages of results: "planner 0.1.0, commit 25f0839".

    The commit is the last that changed the package; it is left out without a git checkout.
    """
    command = ["git", "log", "-1", "--format=%h", "--abbrev=7", "--", "."]
    where = ROOT / "planner"
    try:
        log = subprocess.run(command, cwd=where, capture_output=True, text=True, check=False)
        commit = log.stdout.strip()
    except OSError:  # no git
        commit = ""
    return f"planner {version()}" + (f", commit {commit}" if commit else "")


def provenance(*commands: str) -> str:
    """Return lines for a page that name the version and the commands that made it.

    Returns:
        Markdown without a final newline.
    """
    return "\n".join([f"Made with {release()} by", "", *(f"    {command}" for command in commands)])


def how_to_install(extra: str) -> str:
    """Return the command that adds an extra to this installation.

    Args:
        extra: One of `project.optional-dependencies` in pyproject.toml.

    Returns:
        A line for a shell; in a checkout an editable install of that checkout.
    """
    if not _checkout():
        return f"pip install '{NAME}[{extra}]'"
    where = "." if Path.cwd() == ROOT else ROOT
    return f"pip install -e {shlex.quote(f'{where}[{extra}]')}"


@cache
def _checkout() -> str | None:
    """Return the version in this project's pyproject.toml beside the package, or None."""
    try:
        project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
        return str(project["version"]) if project["name"] == NAME else None
    except (OSError, ValueError, KeyError):
        return None


LIBRARIES = ("casadi", "numpy", "scipy", "osqp")


def versions() -> dict[str, str]:
    """Return the versions of planner, Python, and the libraries that affect the numbers."""
    from importlib import metadata

    return {
        "planner": version(),
        "python": platform.python_version(),
        **{name: metadata.version(name) for name in LIBRARIES},
    }

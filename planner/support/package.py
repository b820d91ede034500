"""The package as it was installed: its name on the index, its version, how to add an extra.

Which version made a page.

What results hand themselves to: functions that are imported when they are used.
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


def import_function(function: str) -> Callable[..., Any]:
    """A function that the caller must not import, by its whole name.

    Only for results that users ask for their tables, pictures and folders: these read results, and
    imports go one way.
    """
    module, _, name = function.rpartition(".")
    imported: Callable[..., Any] = getattr(importlib.import_module(module), name)
    return imported


NAME = "nonholonomic-planner"
"""On the package index, where `planner` is somebody else's; modules and command are `planner`."""

ROOT = Path(__file__).parents[2]


def version() -> str:
    """The version that a checkout's pyproject.toml says, else the one that was installed.

    An editable install keeps the number of the day it was made, so the file is asked first.
    """
    if found := _checkout():
        return found
    from importlib import metadata  # slow to import

    try:
        return metadata.version(NAME)
    except metadata.PackageNotFoundError:  # copied, not installed
        return "unknown"


@cache
def release() -> str:
    """What figures on a page are made with: "planner 0.1.0, commit 25f0839".

    The commit is the last that changed the package; without a checkout under git the version alone.
    """
    asked = ["git", "log", "-1", "--format=%h", "--abbrev=7", "--", "."]
    where = ROOT / "planner"
    try:
        found = subprocess.run(asked, cwd=where, capture_output=True, text=True, check=False)
        commit = found.stdout.strip()
    except OSError:  # no git
        commit = ""
    return f"planner {version()}" + (f", commit {commit}" if commit else "")


def made_by(*commands: str) -> str:
    """The lines of a page that say which version made it, by which commands.

    Returns:
        Markdown without a line's end after it.
    """
    return "\n".join([f"Made with {release()} by", "", *(f"    {command}" for command in commands)])


def how_to_install(extra: str) -> str:
    """The command that adds an extra to this installation.

    Args:
        extra: One of `project.optional-dependencies` in pyproject.toml.

    Returns:
        A line for a shell; in a checkout it installs the checkout, in place.
    """
    if not _checkout():
        return f"pip install '{NAME}[{extra}]'"
    where = "." if Path.cwd() == ROOT else ROOT
    return f"pip install -e {shlex.quote(f'{where}[{extra}]')}"


@cache
def _checkout() -> str | None:
    """The version in the pyproject.toml beside the package; None if there is none, or not ours."""
    try:
        text = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
        project = tomllib.loads(text)["project"]
        return str(project["version"]) if project["name"] == NAME else None
    except (OSError, ValueError, KeyError):
        return None


if TYPE_CHECKING:
    __version__: str
else:

    def __getattr__(name: str) -> str:
        """`__version__`, looked up when it is asked for: that takes a file or slow imports."""
        if name == "__version__":
            return version()
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


LIBRARIES = ("casadi", "numpy", "scipy", "osqp")


def versions() -> dict[str, str]:
    """Versions of the planner, of Python, and of the libraries that numbers depend on."""
    from importlib import metadata

    return {
        "planner": version(),
        "python": platform.python_version(),
        **{name: metadata.version(name) for name in LIBRARIES},
    }

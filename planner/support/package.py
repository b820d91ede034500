"""A package whose public names are imported when they are first used.

Importing everything at once costs more than a plan does. A public name may be that of the module it
lives in (`planner.check` is the function `check` of planner/check.py): it always means the object.

The package as it was installed: its name on the index, its version, and how to add an extra.
"""

from __future__ import annotations

import importlib
import platform
import shlex
import sys
import tomllib
from collections.abc import Callable, Mapping
from functools import cache
from importlib import metadata
from importlib.util import find_spec
from pathlib import Path
from types import ModuleType
from typing import Any


class LazyPackage(ModuleType):
    """A module that knows where its public names live."""

    _homes: dict[str, str]
    _faces: tuple[str, ...]

    def __getattr__(self, name: str) -> Any:
        if name in self._homes:
            value = getattr(importlib.import_module(self._homes[name]), name)
        elif not name.startswith("_") and find_spec(f"{self.__name__}.{name}"):
            value = importlib.import_module(f"{self.__name__}.{name}")
        else:
            raise AttributeError(f"module {self.__name__!r} has no attribute {name!r}")
        setattr(self, name, value)
        return value

    def __setattr__(self, name: str, value: Any) -> None:
        """Python binds an imported module under its name: the object of that name comes first."""
        if isinstance(value, ModuleType) and self._homes.get(name) == value.__name__:
            value = getattr(value, name)
        super().__setattr__(name, value)

    def __dir__(self) -> list[str]:
        """The public names; not the modules that happen to be imported."""
        own = {name for name in vars(self) if name.startswith("__")}
        return sorted({*self._homes, *self._faces, *own})


def handed_to(function: str) -> Callable[..., Any]:
    """A function that the caller must not import, by its whole name.

    Only for results that users ask for their tables, pictures and folders: these read results, and
    imports go one way.
    """
    module, _, name = function.rpartition(".")
    found: Callable[..., Any] = getattr(importlib.import_module(module), name)
    return found


def import_when_used(package: str, names: Mapping[str, str], faces: tuple[str, ...] = ()) -> None:
    """Make a package lazy.

    Args:
        package: Its `__name__`.
        names: Names of its modules to the public names that live there, separated by spaces.
        faces: Packages in it that have public names of their own.
    """
    module = sys.modules[package]
    homes = {name: f"{package}.{home}" for home, all_ in names.items() for name in all_.split()}
    module.__dict__["_homes"], module.__dict__["_faces"] = homes, faces
    module.__class__ = LazyPackage


NAME = "nonholonomic-planner"
"""On the package index, where `planner` is somebody else's; modules and command are `planner`."""

ROOT = Path(__file__).parents[2]


def version() -> str:
    """The version that a checkout's pyproject.toml says, else the one that was installed.

    An editable install keeps the number of the day it was made, so the file is asked first.
    """
    if found := _checkout():
        return found
    try:
        return metadata.version(NAME)
    except metadata.PackageNotFoundError:  # copied, not installed
        return "unknown"


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


LIBRARIES = ("casadi", "numpy", "scipy", "osqp")


def versions() -> dict[str, str]:
    """Versions of the planner, of Python, and of the libraries that numbers depend on."""
    return {
        "planner": version(),
        "python": platform.python_version(),
        **{name: metadata.version(name) for name in LIBRARIES},
    }

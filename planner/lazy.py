"""A package whose public names are imported when they are first used.

Importing everything at once costs more than a plan does. A public name may be that of the module it
lives in (`planner.check` is the function `check` of planner/check.py): it always means the object.
"""

from __future__ import annotations

import importlib
import sys
from collections.abc import Callable, Mapping
from importlib.util import find_spec
from types import ModuleType
from typing import Any


class LazyPackage(ModuleType):
    """A module that knows where its public names live."""

    _homes: dict[str, str]

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
        return sorted({*super().__dir__(), *self._homes})


def handed_to(function: str) -> Callable[..., Any]:
    """A function that the caller must not import, by its whole name.

    Only for results that users ask for their tables, pictures and folders: these read results, and
    imports go one way.
    """
    module, _, name = function.rpartition(".")
    found: Callable[..., Any] = getattr(importlib.import_module(module), name)
    return found


def import_when_used(package: str, names: Mapping[str, str]) -> None:
    """Make a package lazy.

    Args:
        package: Its `__name__`.
        names: Names of its modules to the public names that live there, separated by spaces.
    """
    module = sys.modules[package]
    homes = {name: f"{package}.{home}" for home, all_ in names.items() for name in all_.split()}
    module.__dict__["_homes"] = homes
    module.__class__ = LazyPackage

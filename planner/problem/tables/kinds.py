"""The kinds of systems and registered limits, with their tables, and how to add new ones.

Each kind of system has a subclass of `ProblemFile`. It defines what a user may write in the file,
with types, ranges and descriptions, and builds the system from the file.

Other installed packages can add systems, methods and limits. Such a package names a function under
the entry point `planner.plugins`; the function calls `planner.register_system`,
`planner.register_method` and `planner.register_requirement`. Every process that reads a problem
calls that function, so the worker processes of a sweep have the same systems, methods and limits.
"""

from __future__ import annotations

import inspect
import math
import re
import threading
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import wraps
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from typing import Any, Optional, Union, cast, get_args

from pydantic import TypeAdapter
from pydantic.fields import FieldInfo

from planner.errors import InputError, MethodError, NoPlanError
from planner.problem.requirements.requirement import Requirement
from planner.problem.requirements.self_collision import SelfCollision
from planner.problem.tables import arms, custom, vehicles
from planner.problem.tables.method_options import MethodsTable
from planner.problem.tables.problem_file import BaseLimits, GoalTable, ProblemFile
from planner.support.deadline import TimeUpError
from planner.support.interrupts import Terminated
from planner.support.tables import error_words, line, shorten
from planner.support.user_tables import Table, allowed_hint, parse
from planner.systems.triangular_system import TriangularSystem

GROUP = "planner.plugins"


class _Plugins:
    """State of the plugins of this process.

    Attributes:
        failures: One line for each plugin that failed; None until plugins are called.
        caller: Name and version of the package whose plugin is being called, or "".
        local_names: Names of what was registered without a plugin, such as "method 'mine'".
    """

    failures: list[str] | None = None
    caller = ""

    def __init__(self) -> None:
        self.lock = threading.RLock()  # reentrant, because a plugin may read a problem
        self.local_names: set[str] = set()


_plugins = _Plugins()


def load_plugins() -> None:
    """Call the functions of all installed plugins, once per process.

    Raises:
        InputError: If a plugin fails, now and at every later call, since it may be half registered.
            The message names the plugin, its package and the error.
    """
    with _plugins.lock:
        if _plugins.failures is None:
            _plugins.failures = []
            for entry in sorted(entry_points(group=GROUP), key=lambda entry: entry.name):
                _call(entry, _plugins.failures)
        if _plugins.failures and not _plugins.caller:
            raise InputError("\n".join(_plugins.failures))


def _call(entry: EntryPoint, failures: list[str]) -> None:
    package = "a package" if entry.dist is None else f"{entry.dist.name} {entry.dist.version}"
    _plugins.caller = line(package)
    try:
        entry.load()()
    except (KeyboardInterrupt, Terminated):
        raise
    except BaseException as error:
        failures.append(
            f"plugin '{line(entry.name)}' of {line(package)} ({line(entry.value)}) failed:"
            f" {line(error_words(error))}; fix or uninstall that package"
        )
    finally:
        _plugins.caller = ""


LONGEST_MESSAGE = 300
"""Largest number of characters of a foreign error's message."""


@dataclass(frozen=True)
class Provider:
    """The package that provides a method or a limit.

    Attributes:
        what: Name of the method or limit, as in "method 'mine'".
        package: Name and version of the package, or the module that registered it directly.
    """

    what: str
    package: str

    @classmethod
    def of(cls, what: str, brought: Any) -> Provider:
        """Return the provider of `brought`, a function or class that is being registered."""
        return cls(what, _plugins.caller or f"module {line(str(brought.__module__))}")

    def error(self, what: str, trace: str = "") -> MethodError:
        """Return an error that names the method or limit, the package and what went wrong."""
        return MethodError(f"{self.what} of {self.package} {what}", traceback=trace)

    def call(self, function: Callable[..., Any], *given: Any) -> Any:
        """Call a function of the package and return its value.

        Raises:
            MethodError: If the function raises anything but a refusal (no plan exists or time is
                up) or an interrupt; the message names the package.
        """
        try:
            return function(*given)
        except (NoPlanError, TimeUpError, KeyboardInterrupt, Terminated):
            raise
        except BaseException as error:
            why = line(error_words(error), LONGEST_MESSAGE)
            raise self.error(f"failed: {why}", traceback.format_exc()) from error

    def named(self, method: Callable[..., Any]) -> Callable[..., Any]:
        """Wrap a method of the package's class so that an error names the package."""
        method = inspect.unwrap(method)  # a class may be registered again

        @wraps(method)
        def call(*given: Any) -> Any:
            return self.call(method, *given)

        return call


def remember(what: str) -> None:
    """Remember a name, such as "method 'mine'", that is registered outside a plugin."""
    if not _plugins.caller:
        _plugins.local_names.add(what)


def local_only(*used: str) -> list[str]:
    """Return those names that other processes do not know, since no plugin registers them."""
    return [what for what in used if what in _plugins.local_names]


FILES: dict[str, type[ProblemFile]] = {**arms.FILES, **vehicles.FILES, **custom.FILES}
"""Classes of problem files, by `system.kind`. `load_plugins` adds the kinds of plugins."""

REQUIREMENTS: dict[str, type[Requirement]] = {}
"""Limits that every kind of system can have, by their key in `[limits]`: built-in ones of such a
kind would be entries here; plugins register theirs."""

KIND_LIMITS: tuple[type[Requirement], ...] = (SelfCollision,)
"""Limits that some kinds of systems can have; the `[limits]` tables of those kinds have the key."""


def all_files() -> dict[str, type[ProblemFile]]:
    """Return `FILES` after adding the kinds of all plugins.

    Raises:
        InputError: If a plugin fails.
    """
    load_plugins()
    return FILES


def example_of(kind: str) -> str:
    """Return the first part of the file that `planner new` writes for a kind of system."""
    shipped = Path(__file__).parent / "examples" / f"{kind}.toml"
    return FILES[kind].example.strip() or shipped.read_text(encoding="utf-8").strip()


def register_system(kind: str, file: type[ProblemFile]) -> None:
    """Register a kind of system, so that problem files can use `system.kind = kind`.

    Other processes, such as workers of a sweep, know the kind only if a plugin registers it: a
    package whose entry point `planner.plugins` names a function that calls this one.

    Args:
        kind: Name used in files: letters, digits, - and _.
        file: A subclass of `planner.problem.tables.problem_file.ProblemFile`, with `summary` (one
            line) and `example` (the first part of the file that `planner new` writes). Its tables
            `system`, `start` and `goal` are `planner.support.user_tables.Table`s; `system` has a
            key `kind` of type `Literal[kind]`, `goal` is a `GoalTable`, `limits` a `BaseLimits`.

    Raises:
        InputError: If the kind is taken or invalid, or `file` is not such a class.
    """
    if not isinstance(kind, str) or not re.fullmatch(r"[A-Za-z][A-Za-z0-9_-]*", kind):
        raise InputError(
            f"system kind '{line(str(kind))}' cannot be registered: a kind has letters, digits,"
            " - and _, and begins with a letter"
        )
    if kind in FILES:
        raise InputError(f"system kind '{kind}' is taken, by {FILES[kind].__name__}")
    if why := next(_file_faults(kind, file), None):
        raise InputError(f"system kind '{kind}' cannot be registered: {why}")
    FILES[kind] = file
    _add_requirement_keys()
    remember(f"system '{kind}'")


def register_requirement(kind: type[Requirement]) -> None:
    """Register a kind of limit, so that every problem file can use `limits.KEY`.

    Collocation and desensitised plans keep the limit; retiming respects a limit that depends on the
    speed; `verify` checks the limit, and `certify` proves it if its rows allow that. Other
    processes, such as workers of a sweep, know the limit only if a plugin registers it: a package
    whose entry point `planner.plugins` names a function that calls this one.

    Args:
        kind: A frozen dataclass, subclass of `planner.problem.requirements.requirement.Requirement`
            with `key` (name of the key in files: a-z, 0-9 and _) and `table` (type and description
            of the key's value, and optionally an example). If its `rows` or `values` fail at a
            state, the problem is refused with a `MethodError` that names the package.

    Raises:
        InputError: If the key is taken or invalid, or `kind` is not such a class.
    """
    key, why = getattr(kind, "key", ""), next(_shortcomings(kind), None)
    if why is None and any(key in limits_of(file).model_fields for file in FILES.values()):
        why = "that key is taken, by a kind of system or by another requirement"
    if why:
        raise InputError(f"requirement '{line(str(key))}' cannot be registered: {why}")
    provider = Provider.of(f"limit '{key}'", kind)
    for name in ("rows", "values"):  # they may fail at some states only, in the middle of a search
        if (method := getattr(kind, name)) is not getattr(Requirement, name):
            setattr(kind, name, provider.named(method))
    REQUIREMENTS[key] = kind
    _add_requirement_keys()
    remember(f"requirement '{key}'")


def _shortcomings(kind: Any) -> Iterator[str]:
    """Yield reasons why a class cannot be registered as a kind of limit in problem files."""
    if not isinstance(kind, type) or not issubclass(kind, Requirement):
        yield f"{line(repr(kind))} is not a subclass of Requirement"
        return
    name, drives = line(kind.__name__), getattr(kind, "reads", None)
    if inspect.isabstract(kind):
        yield f"{name} lacks {', '.join(sorted(kind.__abstractmethods__))}"
    if not re.fullmatch(r"[a-z][a-z0-9_]*", kind.key) or hasattr(Table, kind.key):
        yield f"{name}.key is not a name of a-z, 0-9 and _ that begins with a letter"
    if not drives or not drives <= {"q", "u", "du"}:
        yield f"{name}.reads does not say which of 'q', 'u' and 'du' it reads"
    elif drives != {"q"} and (kind.final or not kind.smooth):
        yield f"{name}.reads may be only 'q' in a limit that is not smooth, or final"
    if kind.table is None or not isinstance(kind.table[1], str) or not kind.table[1].strip():
        yield f"{name}.table is not a type and a description"


def limits_of(file: type[ProblemFile]) -> type[BaseLimits]:
    """Return the class of the `[limits]` table of a kind of problem file."""
    return cast("type[BaseLimits]", file.model_fields["limits"].annotation)


def _add_requirement_keys() -> None:
    """Add the keys of `REQUIREMENTS` to the `[limits]` table of every kind of system."""
    for file in FILES.values():
        table = limits_of(file)
        for key, kind in REQUIREMENTS.items():
            if key not in table.model_fields and kind.table:
                value_type, words, *shown = kind.table
                typed: Any = Optional[value_type]  # noqa: UP045
                table.model_fields[key] = FieldInfo(
                    annotation=typed, default=None, description=words, examples=shown or None
                )
                table.model_rebuild(force=True)
    if REQUIREMENTS:
        _rebuild_files()


def _rebuild_files() -> None:
    """Rebuild the file classes that Pydantic has built; it builds the others on first use."""
    for file in FILES.values():
        if file.__pydantic_complete__:
            file.model_rebuild(force=True)


_TABLE_TYPES = {"system": Table, "start": Table, "goal": GoalTable, "limits": BaseLimits}


def _file_faults(kind: str, file: Any) -> Iterator[str]:
    """Yield reasons why a class cannot read the problem files of a kind of system."""
    if not isinstance(file, type) or not issubclass(file, ProblemFile):
        yield f"{line(repr(file))} is not a subclass of ProblemFile"
        return
    name = line(file.__name__)
    if inspect.isabstract(file):
        yield f"{name} lacks {', '.join(sorted(file.__abstractmethods__))}"
    for key, base in _TABLE_TYPES.items():
        table: Any = file.model_fields[key].annotation
        if not isinstance(table, type) or not issubclass(table, base) or inspect.isabstract(table):
            yield f"{name}.{key} is not a table, a concrete subclass of {base.__name__}"
        elif key == "limits" and not (hasattr(table, "inputs") and hasattr(table, "rates")):
            yield f"{name}.limits lacks inputs or rates, the keys that limit the two inputs"
        elif key == "system":
            field = table.model_fields.get("kind")
            if field is None or kind not in get_args(field.annotation):
                yield f"{name}.system has no key kind of type Literal['{kind}']"
    for words in ("summary", "example"):
        text = getattr(file, words)
        if not isinstance(text, str) or not text.strip():
            yield f"{name}.{words} is not a text"


def add_method_table(name: str, options: type[Table]) -> None:
    """Add a table `[method.NAME]` to all problem files; called by the registry of methods."""
    MethodsTable.add(name, options)
    _rebuild_files()


def parse_file(data: dict[str, Any], source: str) -> ProblemFile:
    """Return the validated tables of a problem file.

    Raises:
        InputError: If keys or values are wrong, with one line for each; if a plugin fails; or if
            the kind of system is unknown.
    """
    load_plugins()
    _refuse_extremes(data, source)
    system = data.get("system")
    if not isinstance(system, dict) or "kind" not in system:
        raise InputError(f"missing key 'system.kind'; allowed: {', '.join(FILES)}", source=source)
    kind = system["kind"]
    if not isinstance(kind, str) or kind not in FILES:
        hint = allowed_hint(str(kind), list(FILES))
        raise InputError(f"'system.kind' = {kind!r:.60}: {hint}", source=source)
    with _name_missing_methods(kind):
        return parse(FILES[kind], data, source)


def system_of(tables: ProblemFile) -> TriangularSystem:
    """Build the system that a problem file describes.

    Raises:
        InputError: If the system's class lacks a method that every system needs.
    """
    with _name_missing_methods(tables.system.kind):
        return tables.build_system()


@contextmanager
def _name_missing_methods(kind: str) -> Iterator[None]:
    """Turn a TypeError for missing abstract methods into an `InputError` that names the methods."""
    try:
        yield
    except TypeError as error:
        if "instantiate abstract class" not in str(error):
            raise
        raise InputError(f"system kind '{kind}' is not complete: {error}") from error


LEAST_NUMBER, MOST_NUMBER = 1e-15, 1e15
"""Least and largest magnitude of a number in a problem file, other than zero. Every sensible
length, time, angle, ratio and tolerance lies between, and products of twenty stay finite."""


def _refuse_extremes(data: dict[str, Any], source: str) -> None:
    """Raise an error for numbers that would overflow or underflow during a computation."""
    waiting: list[tuple[str, Any]] = [("", data)]
    while waiting:
        key, value = waiting.pop()
        if isinstance(value, dict):
            waiting += [(f"{key}.{name}".lstrip("."), item) for name, item in value.items()]
        elif isinstance(value, list):
            waiting += [(f"{key}[{k}]", item) for k, item in enumerate(value)]
        elif isinstance(value, float | int) and 0 < abs(value) < LEAST_NUMBER:
            name = shorten(key)
            raise InputError(
                f"'{name}' = {value!r}: too small; 0, or at least {LEAST_NUMBER:g}", source=source
            )
        elif isinstance(value, float | int) and MOST_NUMBER < abs(value) < math.inf:
            few = isinstance(value, float) or value.bit_length() < 200
            shown = repr(value) if few else "a whole number of many digits"
            raise InputError(
                f"'{shorten(key)}' = {shown}: too large; at most {MOST_NUMBER:g}", source=source
            )


def json_schema() -> dict[str, Any]:
    """Return the JSON Schema of a problem file, for editors."""
    kinds: Any = Union[tuple(all_files().values())]  # noqa: UP007
    return TypeAdapter(kinds).json_schema()


_add_requirement_keys()

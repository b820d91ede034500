"""The kinds of systems and of further limits, with their tables, and how a new one comes in.

A kind has one class, a `ProblemFile`: it says what a user may write, with types, ranges and
descriptions, and builds the system from it.

Other installed packages bring systems, methods and limits. Such a package names a function under
the entry point `planner.plugins`; the function calls `planner.register_system`,
`planner.register_method` and `planner.register_requirement`. Every process that reads a problem
calls it, so that the workers of a sweep know the same ones.
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
    """The plugins of this process.

    Attributes:
        failures: One line for each that failed; None until they are called.
        caller: Name and version of the package whose plugin is being called, or "".
        local_names: What was registered by no plugin, as in "method 'mine'".
    """

    failures: list[str] | None = None
    caller = ""

    def __init__(self) -> None:
        self.lock = threading.RLock()  # a plugin may itself read a problem
        self.local_names: set[str] = set()


_plugins = _Plugins()


def load_plugins() -> None:
    """Call the functions of all installed plugins, once a process.

    Raises:
        InputError: If one fails, now and at every later call: half of what it brings may be there.
            Names the plugin, its package and the error.
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
"""Characters of a foreign error's message."""


@dataclass(frozen=True)
class Owner:
    """Who brings a method or a limit.

    Attributes:
        what: What is brought, as in "method 'mine'".
        package: Name and version of the package, or the module where it was registered by hand.
    """

    what: str
    package: str

    @classmethod
    def of(cls, what: str, brought: Any) -> Owner:
        """Of what is being registered, a function or a class."""
        return cls(what, _plugins.caller or f"module {line(str(brought.__module__))}")

    def error(self, what: str, trace: str = "") -> MethodError:
        """The refusal that names both."""
        return MethodError(f"{self.what} of {self.package} {what}", traceback=trace)

    def call(self, function: Callable[..., Any], *given: Any) -> Any:
        """What a function of the package returns.

        Raises:
            MethodError: If it raises anything but a refusal.
        """
        try:
            return function(*given)
        except (NoPlanError, TimeUpError, KeyboardInterrupt, Terminated):
            raise
        except BaseException as error:
            why = line(error_words(error), LONGEST_MESSAGE)
            raise self.error(f"failed: {why}", traceback.format_exc()) from error

    def named(self, method: Callable[..., Any]) -> Callable[..., Any]:
        """A method of its class, which says whose it is if it fails."""
        method = inspect.unwrap(method)  # a class may be registered again

        @wraps(method)
        def call(*given: Any) -> Any:
            return self.call(method, *given)

        return call


def remember(what: str) -> None:
    """Keep in mind what is registered by no plugin, as in "method 'mine'"."""
    if not _plugins.caller:
        _plugins.local_names.add(what)


def local_only(*used: str) -> list[str]:
    """Which of these no other process knows, since no plugin registers them."""
    return [what for what in used if what in _plugins.local_names]


FILES: dict[str, type[ProblemFile]] = {**arms.FILES, **vehicles.FILES, **custom.FILES}
"""By `system.kind`. What plugins register is in it once the first problem is read."""

REQUIREMENTS: dict[str, type[Requirement]] = {}
"""Limits that all kinds of systems know, by their key in `[limits]`; those of plugins likewise.

What is called otherwise in each kind's own words, as the limits of inputs are, is in its tables."""


def all_files() -> dict[str, type[ProblemFile]]:
    """`FILES` with what plugins bring.

    Raises:
        InputError: If a plugin fails.
    """
    load_plugins()
    return FILES


def example_of(kind: str) -> str:
    """First part of the file that `planner new` writes: the class's `example`, or `examples/`."""
    shipped = Path(__file__).parent / "examples" / f"{kind}.toml"
    return FILES[kind].example.strip() or shipped.read_text(encoding="utf-8").strip()


def register_system(kind: str, file: type[ProblemFile]) -> None:
    """Register a kind of system, so that problem files can use `system.kind = kind`.

    Other processes, such as workers of a sweep, know it only from a plugin: a package whose entry
    point `planner.plugins` names a function that calls this one.

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

    Collocation and desensitised plans keep it, retiming respects it if it depends on the speed, and
    `verify` checks it; `certify` proves it if its rows suffice. Other processes, such as workers of
    a sweep, know it only from a plugin: a package whose entry point `planner.plugins` names a
    function that calls this one.

    Args:
        kind: A frozen dataclass, subclass of `planner.problem.requirements.requirement.Requirement`
            with `key` (name of the key in files: a-z, 0-9 and _) and `table` (type and description
            of the key's value, and an example of it if you like). Where its `rows` or `values` fail
            at a state, the problem is refused with a `MethodError`, which names the package.

    Raises:
        InputError: If the key is taken or invalid, or `kind` is not such a class.
    """
    key, why = getattr(kind, "key", ""), next(_shortcomings(kind), None)
    if why is None and any(key in limits_of(file).model_fields for file in FILES.values()):
        why = "that key is taken, by a kind of system or by another requirement"
    if why:
        raise InputError(f"requirement '{line(str(key))}' cannot be registered: {why}")
    owner = Owner.of(f"limit '{key}'", kind)
    for name in ("rows", "values"):  # they may fail at some states only, in the middle of a search
        if (method := getattr(kind, name)) is not getattr(Requirement, name):
            setattr(kind, name, owner.named(method))
    REQUIREMENTS[key] = kind
    _add_requirement_keys()
    remember(f"requirement '{key}'")


def _shortcomings(kind: Any) -> Iterator[str]:
    """Why a class is no kind of requirement that a file can ask for."""
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
    if kind.table is None or not isinstance(kind.table[1], str) or not kind.table[1].strip():
        yield f"{name}.table is not a type and a description"


def limits_of(file: type[ProblemFile]) -> type[BaseLimits]:
    """The table `[limits]` of a kind."""
    return cast("type[BaseLimits]", file.model_fields["limits"].annotation)


def _add_requirement_keys() -> None:
    """Give every kind's `[limits]` the keys of `REQUIREMENTS`."""
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
    """Build those files anew whose tables have changed; the rest are built when they are used."""
    for file in FILES.values():
        if file.__pydantic_complete__:
            file.model_rebuild(force=True)


_TABLE_TYPES = {"system": Table, "start": Table, "goal": GoalTable, "limits": BaseLimits}


def _file_faults(kind: str, file: Any) -> Iterator[str]:
    """Why a class cannot read the problem files of a kind."""
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
        elif key == "system":
            field = table.model_fields.get("kind")
            if field is None or kind not in get_args(field.annotation):
                yield f"{name}.system has no key kind of type Literal['{kind}']"
    for words in ("summary", "example"):
        text = getattr(file, words)
        if not isinstance(text, str) or not text.strip():
            yield f"{name}.{words} is not a text"


def add_method_table(name: str, options: type[Table]) -> None:
    """Give all problem files a table `[method.NAME]`; the registry of methods asks for it."""
    MethodsTable.add(name, options)
    _rebuild_files()


def parse_file(data: dict[str, Any], source: str) -> ProblemFile:
    """Validate a problem file's tables.

    Raises:
        InputError: One line an error; see `parse`. If a plugin fails, or the kind is not complete.
    """
    load_plugins()
    _refuse_extremes(data, source)
    system = data.get("system")
    if not isinstance(system, dict) or "kind" not in system:
        raise InputError(f"{source}: missing key 'system.kind'; allowed: {', '.join(FILES)}")
    kind = system["kind"]
    if not isinstance(kind, str) or kind not in FILES:
        hint = allowed_hint(str(kind), list(FILES))
        raise InputError(f"{source}: 'system.kind' = {kind!r:.60}: {hint}")
    with _name_missing_methods(kind):
        return parse(FILES[kind], data, source)


def system_of(tables: ProblemFile) -> TriangularSystem:
    """The system that a problem file describes.

    Raises:
        InputError: If its class lacks what every system has; names that.
    """
    with _name_missing_methods(tables.system.kind):
        return tables.build_system()


@contextmanager
def _name_missing_methods(kind: str) -> Iterator[None]:
    """Name what the classes of a kind lack; `register_system` asks those of plugins beforehand."""
    try:
        yield
    except TypeError as error:
        if "instantiate abstract class" not in str(error):
            raise
        raise InputError(f"system kind '{kind}' is not complete: {error}") from error


LEAST_NUMBER, MOST_NUMBER = 1e-15, 1e15
"""Sizes of numbers, but zero: no length, time, angle, ratio or tolerance in these units is smaller
or larger, and products of twenty of them, for twenty joints, stay numbers."""


def _refuse_extremes(data: dict[str, Any], source: str) -> None:
    """Refuse numbers that would overflow, or vanish, in the middle of a computation."""
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
                f"{source}: '{name}' = {value!r}: too small; 0, or at least {LEAST_NUMBER:g}"
            )
        elif isinstance(value, float | int) and MOST_NUMBER < abs(value) < math.inf:
            few = isinstance(value, float) or value.bit_length() < 200
            shown = repr(value) if few else "a whole number of many digits"
            raise InputError(
                f"{source}: '{shorten(key)}' = {shown}: too large; at most {MOST_NUMBER:g}"
            )


def json_schema() -> dict[str, Any]:
    """JSON Schema of a problem file, for editors."""
    kinds: Any = Union[tuple(all_files().values())]  # noqa: UP007
    return TypeAdapter(kinds).json_schema()


_add_requirement_keys()

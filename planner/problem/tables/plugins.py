"""What other installed packages bring: systems, methods and limits that they register themselves.

A package names a function under the entry point `planner.plugins`; the function calls
`planner.register_system`, `planner.register_method` and `planner.register_requirement`. Every
process that reads a problem calls it, so that the workers of a sweep know the same ones.
"""

from __future__ import annotations

import threading
from importlib.metadata import EntryPoint, entry_points

from planner.errors import InputError
from planner.support.tables import line

GROUP = "planner.plugins"


class _Plugins:
    """The plugins of this process.

    Attributes:
        failures: One line for each that failed; None until they are called.
        running: Whether they are being called.
        elsewhere_unknown: What was registered by no plugin, as in "method 'mine'".
    """

    failures: list[str] | None = None
    running = False

    def __init__(self) -> None:
        self.lock = threading.RLock()  # a plugin may itself read a problem
        self.elsewhere_unknown: set[str] = set()


_plugins = _Plugins()


def load_plugins() -> None:
    """Call the functions of all installed plugins, once a process.

    Raises:
        InputError: If one fails, now and at every later call: half of what it brings may be there.
            Names the plugin, its package and the error.
    """
    with _plugins.lock:
        if _plugins.failures is None:
            _plugins.failures, _plugins.running = [], True
            try:
                for entry in sorted(entry_points(group=GROUP), key=lambda entry: entry.name):
                    _call(entry, _plugins.failures)
            finally:
                _plugins.running = False
        if _plugins.failures and not _plugins.running:
            raise InputError("\n".join(_plugins.failures))


def _call(entry: EntryPoint, failures: list[str]) -> None:
    try:
        entry.load()()
    except (Exception, SystemExit) as error:
        package = "a package" if entry.dist is None else f"{entry.dist.name} {entry.dist.version}"
        failures.append(
            f"plugin '{line(entry.name)}' of {line(package)} ({line(entry.value)}) failed:"
            f" {type(error).__name__}: {line(str(error))}; fix or uninstall that package"
        )


def remember(what: str) -> None:
    """Keep in mind what is registered by no plugin, as in "method 'mine'"."""
    if not _plugins.running:
        _plugins.elsewhere_unknown.add(what)


def unknown_elsewhere(*used: str) -> list[str]:
    """Which of these no other process knows, since no plugin registers them."""
    return [what for what in used if what in _plugins.elsewhere_unknown]

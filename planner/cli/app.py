"""The command `planner`.

Exit status: 0 done; 2 bad input; 3 no plan; 1 a bug; 130 Ctrl-C; 143 terminated.
"""

from __future__ import annotations

import errno
import gc
import io
import os
import sys
import traceback
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from importlib import import_module
from typing import Annotated, Any, TextIO

import typer
from typer.core import TyperGroup

from planner.cli.output import (
    INTERRUPT_STATUS,
    Command,
    ReaderGoneError,
    ReportedStatus,
    add_common_options,
    fit_console,
    is_interrupted,
    manner,
    print_json,
    reserve_output,
    say,
)
from planner.errors import NO_MEMORY, InputWarning, MethodError, PlannerError, lacks_memory
from planner.support.files import written_paths
from planner.support.interrupts import Terminated, hear_signals, signal_listener
from planner.support.package import version as installed_version
from planner.support.tables import clean_text, shorten

MAX_MESSAGE = 5000
"""Maximum length of a message in characters, about what a terminal shows at once."""
DISK_FULL_ERRORS = (errno.ENOSPC, errno.EDQUOT)
"""Error numbers of a full disk."""

# Some versions of Typer ship their own copy of click; this finds the base class in every version.
UsageError: type[Exception] = typer.BadParameter.__mro__[1]

COMMANDS = {
    "new": ("start", "Write a commented problem file that can be solved as it is."),
    "plan": ("plan", "Make a plan, verify it and print its properties."),
    "verify": ("plan", "Judge a saved plan anew, by an independent integrator."),
    "check": ("check", "Find out whether there is a plan; if not, say why not."),
    "compare": ("compare", "Compare methods on the same emulated machines."),
    "budget": ("compare", "Compute how much error each effect of the machine causes."),
    "sensitivity": ("sensitivity", "Compute how errors shift the end of a plan."),
    "sweep": ("sweep", "Run those cases of a sweep that are not yet in the database."),
    "design": ("sweep", "Compare designs of the mechanism, and recommend one."),
    "motion": ("bench", "Make a motion to home, seat, identify or test an arm."),
    "log": ("bench", "Check a recorded run, and compare it with its plan."),
    "identify": ("bench", "Find the machine of an arm from recorded runs."),
    "export": ("files", "Write a plan as a file for another program."),
    "animate": ("files", "Write plans as a film (GIF or MP4) with a common clock."),
    "report": ("files", "Write a comparison as one HTML page."),
    "calibrate": ("paper", "Fit the emulated prototype to the paper's experiment."),
    "reproduce": ("paper", "Regenerate the paper's figures and check its printed numbers."),
    "methods": ("start", "List the planning methods, one per line."),
    "systems": ("start", "List the kinds of systems, one per line."),
    "schema": ("start", "Print the JSON Schema of a kind of file."),
}
"""Each command's module and the first line of its help, so that `--help` imports no module."""


def load_command(name: str) -> Command:
    """Import the module of a command and return the command's function."""
    function: Command = getattr(import_module(f"planner.cli.{COMMANDS[name][0]}"), name)
    return function


class _Commands(TyperGroup):
    """Typer's group of all commands, which imports the module of the command that runs."""

    def resolve_command(self, ctx: Any, args: list[str]) -> tuple[Any, Any, list[str]]:
        name, _, rest = super().resolve_command(ctx, args)
        if name is None:  # the shell completes an unfinished line
            return None, None, rest
        single = typer.Typer(add_completion=False, rich_markup_mode=None)
        single.command(name)(add_common_options(load_command(name)))
        return name, typer.main.get_command(single), rest


app = typer.Typer(
    name="planner",
    cls=_Commands,
    no_args_is_help=True,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)


def _print_version(active: bool) -> None:
    if active:
        print(f"planner {installed_version()}")
        raise typer.Exit


@app.callback()
def _root_options(
    version: Annotated[
        bool,
        typer.Option(
            "--version", help="Print the version.", callback=_print_version, is_eager=True
        ),
    ] = False,
    debug: Annotated[
        bool, typer.Option("--debug", help="Show the traceback of a bug.", envvar="PLANNER_DEBUG")
    ] = False,
) -> None:
    """Plan motions of nonholonomic manipulators and replay them on an emulated machine.

    \b
    Examples:
      planner new                    writes problem.toml, commented
      planner check problem.toml     is there a plan, and if not, why not
      planner compare problem.toml --out out/mine --report

    Exit status: 0 done; 2 bad input; 3 no plan exists or none was found; 1 a bug; 130 Ctrl-C;
    143 terminated.
    Your shell completes commands and names after: planner --install-completion
    """


def _stand_in() -> None:
    """Do nothing, in place of a command whose module is not imported yet."""


for _name, (_, _line) in COMMANDS.items():
    app.command(_name, help=_line)(_stand_in)


def main(arguments: Sequence[str] | None = None, *, last: bool = False) -> int:
    """Run the command line and return its exit status.

    Args:
        arguments: Words after `planner`. By default the arguments of the process.
        last: Whether the process ends after this call; see `hear_signals`.

    Returns:
        The exit status.
    """
    words = sys.argv[1:] if arguments is None else list(arguments)
    sys.stdout = sys.stdout or _null_stream()  # None if the caller has closed it
    sys.stderr = sys.stderr or _null_stream()
    if last:
        os.environ.pop("MPLBACKEND", None)  # no figure needs one, and an unknown one would fail
        gc.disable()  # modules stay loaded, so a collection frees nothing
    if (name := next((word for word in words if not word.startswith("-")), "")) in COMMANDS:
        load_command(name)  # `planner_start` still handles signals here
    if last:
        gc.freeze()
        gc.enable()
    try:
        json_only = "--json" in words and not {"-h", "--help", "--version"} & set(words)
        with fit_console(), hear_signals(last), _show_warnings(), reserve_output(json_only, last):
            return _run(words)
    except (ReaderGoneError, BrokenPipeError):
        sys.stdout = _null_stream()  # else the flush at exit would fail
        return 0


@contextmanager
def _show_warnings() -> Iterator[None]:
    """Print warnings about the input in the format of the command, each only once."""
    with warnings.catch_warnings():
        warnings.simplefilter("always", InputWarning)
        usual, messages = warnings.showwarning, set[str]()

        def show(message: Any, category: type[Warning], *place: Any, **more: Any) -> None:
            if not issubclass(category, InputWarning):
                usual(message, category, *place, **more)
            elif str(message) not in messages:
                messages.add(str(message))
                say(f"warning: {message}", "yellow")

        warnings.showwarning = show
        yield


def _null_stream() -> TextIO:
    """Return a stream that discards its output."""
    return open(os.devnull, "w", encoding="utf-8")


def _run(words: list[str]) -> int:
    """Run a command and return its exit status; ignore signals once the status is known."""
    written_paths.clear()
    manner.as_json, manner.words = "--json" in words, words  # also for usage errors
    try:
        command = typer.main.get_command(app)
        status = command.main(words, prog_name="planner", standalone_mode=False)
        sys.stdout.flush()
    except (ReaderGoneError, BrokenPipeError):
        raise
    except SystemExit as end:
        if isinstance(end.__context__, BrokenPipeError):  # click turns it into status 1
            raise ReaderGoneError from None
        raise
    except BaseException as error:
        signal_listener.is_over = True
        return _report_failure(error, words)
    signal_listener.is_over = True
    if status == INTERRUPT_STATUS and not isinstance(status, ReportedStatus):
        return _report_interruption()
    return int(status or 0) if words else 2  # no command: older versions of click return 0


def _report_failure(error: BaseException, words: list[str]) -> int:
    # A signal can surface as another error: compiled code swallows it and reports that there is no
    # plan, and an import raises its own error. A command that reported what it saved comes first.
    has_reason = isinstance(error, PlannerError) and error.exit_status >= INTERRUPT_STATUS
    stopped = isinstance(error, KeyboardInterrupt | Terminated | typer.Abort)
    if stopped or (is_interrupted() and not has_reason):
        return _report_interruption()
    if isinstance(error, PlannerError):
        if isinstance(error, MethodError) and _wants_traceback(words):
            sys.stderr.write(clean_text(error.traceback))
        return _print_error(error.exit_status, getattr(error, "status", "bad_input"), str(error))
    if isinstance(error, UsageError):
        return _report_usage_error(error)
    if message := _fault_of_surroundings(error):
        return _print_error(2, "bad_input", message)
    return _report_bug(words, error)


def _fault_of_surroundings(error: BaseException) -> str:
    """Return what is wrong with the computer (full disk, missing package, memory), or ""."""
    if isinstance(error, OSError) and error.errno in DISK_FULL_ERRORS:
        return f"cannot write {error.filename or 'standard output'}: {error.strerror}"
    if isinstance(error, ModuleNotFoundError) and not (error.name or "").startswith("planner"):
        return f"this needs {error.name}, which is not installed"
    return NO_MEMORY.format(str(error) or "MemoryError") if lacks_memory(error) else ""


def _report_interruption() -> int:
    what = "interrupted" if signal_listener.status == INTERRUPT_STATUS else "terminated"
    files = [str(path) for path in written_paths if path.exists()]
    state = f"{', '.join(files)} written before" if files else "nothing written"
    return _print_error(signal_listener.status, what, f"{what}, {state}")


def _print_error(status: int, kind: str, message: str) -> int:
    if manner.as_json:
        try:
            print_json({"status": kind, "error": message, "exit_status": status})
        except PlannerError as error:
            message = str(error)
    say(f"planner: {shorten(message, MAX_MESSAGE)}", "" if status >= INTERRUPT_STATUS else "red")
    return status


def _report_usage_error(error: Any) -> int:
    error.message = error.message.replace("Value error, ", "")  # Pydantic's words, not the user's
    if manner.as_json:
        print_json({"status": "bad_input", "error": error.format_message(), "exit_status": 2})
    text = io.StringIO()
    error.show(file=text)
    say(text.getvalue().rstrip())
    return 2


def _wants_traceback(words: list[str]) -> bool:
    return "--debug" in words or bool(os.environ.get("PLANNER_DEBUG"))


def _report_bug(words: list[str], error: BaseException) -> int:
    if _wants_traceback(words):
        traceback.print_exception(error)
    message = (
        f"a bug in planner {installed_version()}: {type(error).__name__}: {error}. Please report it"
        " with the problem file and this command; `planner --debug ...` shows the traceback."
    )
    return _print_error(1, "bug", message)

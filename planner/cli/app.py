"""The command `planner`.

Exit status: 0 done; 2 bad input; 3 no plan; 1 a bug; 130 Ctrl-C; 143 terminated.
"""

from __future__ import annotations

import errno
import io
import os
import sys
import traceback
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Annotated, Any, TextIO

import typer

from planner.cli.compare import budget, compare
from planner.cli.files import animate, export, report
from planner.cli.output import (
    INTERRUPTED,
    Told,
    interrupted,
    print_json,
    say,
    with_volume,
)
from planner.cli.paper import calibrate, reproduce
from planner.cli.plan import check, plan
from planner.cli.sensitivity import sensitivity
from planner.cli.standard_output import ReaderGoneError, results_alone
from planner.cli.start import methods, new, schema, systems
from planner.cli.sweep import design, sweep
from planner.errors import NO_MEMORY, InputWarning, MethodError, PlannerError, lacks_memory
from planner.support.files import written
from planner.support.interrupts import Terminated, hear_signals, hearing
from planner.support.package import version as installed_version
from planner.support.tables import brief, clean

LONGEST = 5000
"""Characters of a message: about what a terminal shows at once."""
FULL = (errno.ENOSPC, errno.EDQUOT)
"""Numbers of the errors that a full disk gives."""

# Typer brings its own copy of click in some versions; this is the base of usage errors in all.
UsageError: type[Exception] = typer.BadParameter.__mro__[1]

app = typer.Typer(
    name="planner",
    no_args_is_help=True,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)


def _version(wanted: bool) -> None:
    if wanted:
        print(f"planner {installed_version()}")
        raise typer.Exit


@app.callback()
def _top(
    version: Annotated[
        bool, typer.Option("--version", help="Print the version.", callback=_version, is_eager=True)
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


for _command in (
    new,
    plan,
    check,
    compare,
    budget,
    sensitivity,
    sweep,
    design,
    export,
    animate,
    report,
    calibrate,
    reproduce,
    methods,
    systems,
    schema,
):
    app.command()(with_volume(_command))


def main(arguments: Sequence[str] | None = None, *, last: bool = False) -> int:
    """Run the command line.

    Args:
        arguments: Words after `planner`; those of the process when left out.
        last: Whether the process ends after it; see `hear_signals`.

    Returns:
        The exit status.
    """
    words = sys.argv[1:] if arguments is None else list(arguments)
    for name in ("stdout", "stderr"):  # None where the caller has closed it
        if getattr(sys, name) is None:
            setattr(sys, name, _nowhere())
    try:
        alone = "--json" in words and not {"-h", "--help", "--version"} & set(words)
        with hear_signals(last), _warnings_told(), results_alone(alone, last):
            return _run(words)
    except (ReaderGoneError, BrokenPipeError):
        sys.stdout = _nowhere()  # the interpreter would fail to flush the old one at exit
        return 0


@contextmanager
def _warnings_told() -> Iterator[None]:
    """Warnings about the input in the command's own words, each once."""
    with warnings.catch_warnings():
        warnings.simplefilter("always", InputWarning)
        usual, told = warnings.showwarning, set[str]()

        def show(
            message: Warning | str,
            category: type[Warning],
            filename: str,
            lineno: int,
            file: TextIO | None = None,
            line: str | None = None,
        ) -> None:
            if not issubclass(category, InputWarning):
                usual(message, category, filename, lineno, file, line)
            elif str(message) not in told:
                told.add(str(message))
                say(f"warning: {message}", "yellow")

        warnings.showwarning = show
        yield


def _nowhere() -> TextIO:
    """A stream that discards its output."""
    return open(os.devnull, "w", encoding="utf-8")


def _run(words: list[str]) -> int:
    """The outcome; from the moment it is decided on, no signal disturbs telling it."""
    written.clear()
    try:
        command = typer.main.get_command(app)
        status = command.main(words, prog_name="planner", standalone_mode=False)
        sys.stdout.flush()
    except (ReaderGoneError, BrokenPipeError):
        raise
    except SystemExit as end:
        if isinstance(end.__context__, BrokenPipeError):  # click makes a status 1 of it
            raise ReaderGoneError from None
        raise
    except BaseException as error:
        hearing.over = True
        return _failed(error, words)
    hearing.over = True
    if status == INTERRUPTED and not isinstance(status, Told):
        return _interrupted("--json" in words)
    return int(status or 0) if words else 2  # no command: older versions of click say 0


def _failed(error: BaseException, words: list[str]) -> int:
    as_json = "--json" in words
    # Compiled code swallows signals and says that there is no plan; modules that are being loaded
    # make an error of their own of them. A command that told what it kept has the last word.
    told = isinstance(error, PlannerError) and error.exit_status >= INTERRUPTED
    ended = isinstance(error, KeyboardInterrupt | Terminated | typer.Abort)
    if ended or (interrupted() and not told):
        return _interrupted(as_json)
    if isinstance(error, PlannerError):
        if isinstance(error, MethodError) and _debugging(words):
            sys.stderr.write(clean(error.traceback))
        kind = getattr(error, "status", "bad_input")
        return _refuse(as_json, error.exit_status, kind, str(error))
    if isinstance(error, UsageError):
        return _usage(as_json, error)
    if isinstance(error, OSError) and error.errno in FULL:
        where = error.filename or "standard output"
        return _refuse(as_json, 2, "bad_input", f"cannot write {where}: {error.strerror}")
    if lacks_memory(error):
        return _refuse(as_json, 2, "bad_input", NO_MEMORY.format(str(error) or "MemoryError"))
    return _bug(as_json, words, error)


def _interrupted(as_json: bool) -> int:
    what = "interrupted" if hearing.status == INTERRUPTED else "terminated"
    there = [str(path) for path in written if path.exists()]
    left = f"{', '.join(there)} was written before" if there else "nothing written"
    return _refuse(as_json, hearing.status, what, f"{what}, {left}")


def _refuse(as_json: bool, status: int, kind: str, message: str) -> int:
    if as_json:
        try:
            print_json({"status": kind, "error": message, "exit_status": status})
        except PlannerError as error:
            message = str(error)
    say(f"planner: {brief(message, LONGEST)}", "" if status >= INTERRUPTED else "red")
    return status


def _usage(as_json: bool, error: Any) -> int:
    if as_json:
        print_json({"status": "bad_input", "error": error.format_message(), "exit_status": 2})
    shown = io.StringIO()
    error.show(file=shown)
    sys.stderr.write(clean(shown.getvalue()))
    return 2


def _debugging(words: list[str]) -> bool:
    return "--debug" in words or bool(os.environ.get("PLANNER_DEBUG"))


def _bug(as_json: bool, words: list[str], error: BaseException) -> int:
    if _debugging(words):
        traceback.print_exception(error)
    message = (
        f"a bug in planner {installed_version()}: {type(error).__name__}: {error}. Please report it"
        " with the problem file and this command; `planner --debug ...` shows the traceback."
    )
    return _refuse(as_json, 1, "bug", message)

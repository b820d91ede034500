"""Explore a problem in a notebook: sliders next to figures of the plan."""

from __future__ import annotations

from typing import TYPE_CHECKING

from planner.errors import InputError, expect_number
from planner.methods.registry import find_method
from planner.problem.problem import AnyProblem, problem_of
from planner.support.deadline import check_seconds
from planner.support.package import how_to_install

if TYPE_CHECKING:
    from planner.explorer.widget import Explorer


def explore(
    problem: AnyProblem,
    method: str = "collocation",
    samples: int = 20,
    time_limit_s: float | None = 30.0,
) -> Explorer:
    """Show an explorer in a notebook: sliders for the problem, and figures that follow them.

    The call must be the last expression of a notebook cell. Sliders set the system's constants,
    start, goal, travel, duration, constraint points (which can also be dragged in the figure), the
    options of the method, the limits and the effects of the machine. During planning the figures
    are grey, the elapsed time is shown, and a button stops the planning. A refused plan is drawn
    with the reason. Beside the plan stands a second one, by default of the polynomial with chosen
    constraint points, with a table of both; a button keeps the plan on the screen beside later
    ones. Buttons show the mechanism, the Python code and the problem file. In Python:
    `explorer.plan`, `explorer.problem`, `explorer.code` and `explorer.problem_file`.

    Unless the problem sets these options, collocation tries fewer first guesses and the machine is
    simulated in steps of 0.01 s; the code and the problem file contain these settings.

    Args:
        problem: The problem to start from.
        method: The method to start with.
        samples: Number of random machines on which every plan is replayed; 0 for none.
        time_limit_s: Seconds for planning, unless the problem's options set a limit; None means no
            limit.

    Raises:
        InputError: If the extra `notebook` is not installed, or the method is unknown.
    """
    problem = problem_of(problem)
    find_method(method)
    expect_number("samples", samples, "a whole number, at least 0", 0, whole=True)
    try:
        from planner.explorer.widget import Explorer
    except ModuleNotFoundError as error:
        if (error.name or "").startswith("planner"):
            raise
        raise InputError(
            f"planner.explore needs {error.name}; install it with: {how_to_install('notebook')}"
        ) from None
    return Explorer(
        problem, method, samples, None if time_limit_s is None else check_seconds(time_limit_s)
    )

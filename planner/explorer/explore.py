"""Exploring a problem in a notebook: sliders on one side, the plan's picture on the other."""

from __future__ import annotations

from typing import TYPE_CHECKING

from planner.errors import InputError
from planner.problem.problem import Problem, expect_problem
from planner.support.deadline import checked
from planner.support.package import how_to_install

if TYPE_CHECKING:
    from planner.explorer.widget import Explorer


def explore(
    problem: Problem,
    method: str = "polynomial",
    samples: int = 20,
    time_limit_s: float | None = 30.0,
) -> Explorer:
    """Sliders for everything that shapes a plan, and a picture that follows them.

    Show it as the last expression of a notebook's cell. The system's constants, start and goal, the
    travel, the duration, constraint points (also dragged in the picture), the method's weights, the
    limits and the effects of the machine can be set. While it plans, the picture is grey and says
    for how long; a button stops it. A refused plan is still drawn, with the reason. The buttons
    give the Python code and the problem file of what is on the screen; in Python, `explorer.plan`,
    `explorer.problem`, `explorer.code` and `explorer.problem_file` do.

    While it is explored, collocation tries fewer starts and the machine is simulated in steps of
    0.01 s, unless the problem says otherwise; the code and the problem file say so.

    Args:
        problem: What to start from.
        method: The method to start with.
        samples: Samples of the machine that every plan is replayed on; 0 for none.
        time_limit_s: Seconds for planning, where the problem's options set none; None for no limit.

    Raises:
        InputError: If the extra `notebook` is not installed, or the method is unknown.
    """
    from planner.methods.registry import find_method

    expect_problem(problem)
    find_method(method)
    if isinstance(samples, bool) or not isinstance(samples, int) or samples < 0:
        raise InputError(f"samples = {samples}: must be a whole number, at least 0")
    try:
        from planner.explorer.widget import Explorer
    except ModuleNotFoundError as error:
        if (error.name or "").split(".")[0] not in ("anywidget", "tomli_w"):
            raise
        raise InputError(
            f"planner.explore needs {error.name}; install it with: {how_to_install('notebook')}"
        ) from None
    return Explorer(
        problem, method, samples, None if time_limit_s is None else checked(time_limit_s)
    )

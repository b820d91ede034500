"""`planner check`: whether there is a plan and of what kind; if not, why and what would help."""

from __future__ import annotations

from collections.abc import Iterator

from rich.table import Table

from planner.check import Analysis
from planner.check import check as analyse
from planner.cli.arguments import (
    Changes,
    PlannedMethods,
    ProblemPath,
    TimeLimit,
    join_methods,
    read_problem,
)
from planner.cli.output import finish, job, manner
from planner.errors import NoPlanError
from planner.problem.settings import changed_settings, problem_words
from planner.report.analysis import findings, methods_table, refusals, unpromised_limits
from planner.support.tables import CommandLine, facts


def check(
    problem: ProblemPath,
    changes: Changes = None,
    method_names: PlannedMethods = None,
    time_limit: TimeLimit = None,
) -> int:
    """Find out whether there is a plan; if not, say why not.

    Tries every method (without --methods also polynomial:points=auto and piecewise:slots=10), then
    changes of the problem that may help. Ends with status 0 if one method has a verified plan, else
    3. --verbose adds the mathematics: chained coordinates, possible travels, controllability, which
    limits each method keeps.

    \b
    Examples:
      planner check problems/paper.toml
      planner check problems/paper.toml --verbose
      planner check problems/paper-fig5.toml --set goal.travel=0.82
      planner check problems/unreachable.toml --json
    """
    task = read_problem(problem, changes)
    with job("checking") as notice:
        analysis = analyse(
            task, join_methods(method_names), progress=notice, time_limit_s=time_limit
        )
    mathematics: list[str | Table] = ["For the mathematics: --verbose"]
    if manner.verbose:
        mathematics = [facts(findings(analysis)), *unpromised_limits(analysis)]
    return finish(
        {"file": task.source, **analysis.to_dict()},
        analysis.verdict,
        *_next_step(analysis),
        *("", methods_table(analysis)),
        *refusals(analysis),
        *("", *mathematics),
        status=0 if analysis.has_plan else NoPlanError.exit_status,
    )


def _next_step(analysis: Analysis) -> Iterator[str]:
    """Yield the command to run next, if the verdict suggests one."""
    if analysis.has_plan:
        words = ["planner", "compare", *problem_words(analysis.problem)]
        yield CommandLine.of(*words, after="Next: ")
    elif analysis.remedy is not None:
        changed = analysis.problem.changed(analysis.remedy.changes)
        if changed_settings(changed) is not None:
            words = ["planner", "plan", *problem_words(changed), "--method", analysis.remedy.method]
            yield CommandLine.of(*words, after="Next: ")

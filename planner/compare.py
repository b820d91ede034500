"""Many methods on one problem, every plan on the same emulated machines."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from planner.errors import InputError, NoPlanError, SingularError, VerificationError, Violation
from planner.machine import Machine
from planner.measures import effort, peak_inputs
from planner.plan import Plan
from planner.problem import Problem
from planner.replay import RECORD_S, Replay
from planner.replay import replay as run_replay
from planner.solve import solve_and_check
from planner.spec import Spec, parse_specs
from planner.verify import Check, verify

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from rich.table import Table

FORMAT = "planner-comparison"
VERSION = 1

Progress = Callable[[str, float], None]
"""Called with what is being done and the share of all work that is done, 0 … 1."""


@dataclass(frozen=True)
class Row:
    """What became of one method. Numbers are NaN where they are not defined.

    Attributes:
        label: The spec it came from.
        method: Name of the method.
        solved: Whether it gave a verified plan.
        why: Why not, in one line; empty when solved.
        plan: The plan; a refused one is kept when it is complete, for study; else None.
        travel_rad: q₁(T) − q₁(0), rad (metres for vehicles).
        duration_s: Duration, s.
        effort: ∫ u₁² + u₂² dt.
        peak_u: Largest |u₁| and |u₂|, shape (2,), in the inputs' units (rad/s).
        domain_margin: Least margin of the chart's domain; negative outside.
        domain_ok: Whether the path stays inside; None without a path.
        terminal_error_deg: Largest error of an angle at the goal by ideal kinematics (`verify`).
        E_median_deg: Median over machines of the paper's index of error E, eq. (29).
        E_p95_deg: Its 95th percentile.
        solve_time_s: Seconds the method spent solving, as it reports.
        build_time_s: Seconds it spent preparing.
        replay: The runs on the machines; None for what cannot be executed.
    """

    label: str
    method: str
    solved: bool
    why: str
    plan: Plan | None = None
    travel_rad: float = np.nan
    duration_s: float = np.nan
    effort: float = np.nan
    peak_u: tuple[float, float] = (np.nan, np.nan)
    domain_margin: float = np.nan
    domain_ok: bool | None = None
    terminal_error_deg: float = np.nan
    E_median_deg: float = np.nan
    E_p95_deg: float = np.nan
    solve_time_s: float = np.nan
    build_time_s: float = np.nan
    replay: Replay | None = None

    def to_dict(self) -> dict[str, Any]:
        """JSON-ready facts, without the curves; None where a number is not defined."""
        skipped = {"plan", "replay"}
        data = {key: value for key, value in vars(self).items() if key not in skipped}
        data["peak_u_rad_s"] = data.pop("peak_u")
        data["status"] = None if self.plan is None else self.plan.status
        data["replay"] = None if self.replay is None else self.replay.summary()
        return dict(jsonable(data))


@dataclass(frozen=True, eq=False)
class Comparison:
    """One row a method; see `compare`.

    Attributes:
        problem: What all of them solve.
        rows: In the order asked for.
        machine: The distribution of machines that every plan met.
        samples: Number of machines drawn from it.
        seed: Seed of the draws.
    """

    problem: Problem
    rows: tuple[Row, ...]
    machine: Machine
    samples: int
    seed: int

    def __getitem__(self, label: str) -> Row:
        for row in self.rows:
            if row.label == label:
                return row
        raise InputError(f"no row '{label}'; there are: {', '.join(r.label for r in self.rows)}")

    @property
    def plans(self) -> Mapping[str, Plan | None]:
        """Each label's plan, as the figures take them."""
        return {row.label: row.plan for row in self.rows}

    def to_dict(self) -> dict[str, Any]:
        """JSON-ready: rows, problem, machine, seed, versions and the command that repeats it."""
        from planner.report.provenance import command, versions

        data = {
            "format": FORMAT,
            "version": VERSION,
            "source": self.problem.source,
            "command": command(self),
            "samples": self.samples,
            "seed": self.seed,
            "rows": [row.to_dict() for row in self.rows],
            "problem": self.problem.to_dict(),
            "machine": self.machine.to_dict(),
            "versions": versions(),
        }
        return dict(jsonable(data))

    # The report reads comparisons; the methods below only make it easy to reach, and import it
    # when asked, so that imports keep flowing one way.

    def table(self) -> Table:
        """For a terminal, at most 100 columns wide: `rich.print(comparison.table())`."""
        from planner.report.table import rich_table

        return rich_table(self)

    def markdown(self) -> str:
        """The table as Markdown text."""
        from planner.report.table import markdown

        return markdown(self)

    def figures(self) -> dict[str, Figure]:
        """Figures by name: z, joints, inputs, arm, errors, replay; those that apply."""
        from planner.report.figures import figures

        return figures(self)

    def save(self, folder: str | Path) -> Path:
        """Write table, figures, plans and data to a folder, all or nothing.

        Raises:
            InputError: If the folder cannot be written or holds something else.
        """
        from planner.report.folder import save

        return save(self, folder)


def compare(
    problem: Problem,
    methods: str | Sequence[str] | None = None,
    *,
    machine: Machine | None = None,
    samples: int = 1000,
    seed: int = 0,
    progress: Progress | None = None,
) -> Comparison:
    """Plan one problem by several methods and replay every plan on the same emulated machines.

    A plan that is refused for breaking a limit, but can be executed, is replayed too: its row says
    why it is refused and its error shows what the limit costs on the machine.

    Args:
        problem: What to solve.
        methods: Names of methods with options, as in "polynomial:travel=middle" or
            "collocation:intervals=20:degree=2". By default the polynomial at its best travel (and,
            when the travel is free, in the middle of the travels it can use) and collocation.
        machine: The machine; the problem's `[machine]` table when left out.
        samples: Number of machines drawn, at least 1.
        seed: Seed of the draws; the same seed gives the same machines.
        progress: Told what is being done; see `Progress`.

    Raises:
        InputError: If a method, an option, or a number is wrong.
    """
    if isinstance(samples, bool) or not isinstance(samples, int) or samples < 1:
        raise InputError(f"samples = {samples}: must be a whole number, at least 1")
    specs = parse_specs(problem, default_methods(problem) if methods is None else methods)
    machine = Machine.from_table(problem.machine) if machine is None else machine
    rows = []
    for k, spec in enumerate(specs):
        part = partial(_part, progress, k, len(specs), spec.label)
        part("planning", 0.0)
        row = _planned(problem, spec)
        part("replaying", 0.5)
        rows.append(_replayed(row, machine, samples, seed, part))
        part("done", 1.0)
    return Comparison(problem, tuple(rows), machine, samples, seed)


def default_methods(problem: Problem) -> list[str]:
    """What `compare` runs when no method is named.

    With the travel free the polynomial is shown twice, at an ordinary travel and at its best one,
    so that the comparison with a planner that chooses its travel is fair.
    """
    ordinary = ["polynomial:travel=middle"] if problem.travel is None else []
    return [*ordinary, "polynomial", "collocation"]


def jsonable(value: Any) -> Any:
    """Plain lists, dictionaries and finite numbers; None in place of NaN and infinity."""
    if isinstance(value, Mapping):
        return {str(key): jsonable(item) for key, item in value.items()}
    if isinstance(value, list | tuple | np.ndarray):
        return [jsonable(item) for item in value]
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, float) and not np.isfinite(value):
        return None
    return value


def _part(
    progress: Progress | None, k: int, count: int, label: str, doing: str, share: float
) -> None:
    if progress is not None:
        progress(f"{doing} {label}", (k + share) / count)


def _planned(problem: Problem, spec: Spec) -> Row:
    """The row without its replay."""
    try:
        plan, check = solve_and_check(problem, spec.method, **spec.options)
        why = "" if plan.verified else _outside(plan.domain.singular_times_s)
    except NoPlanError as error:
        kept = _complete(error)
        if kept is None:
            return Row(spec.label, spec.method, False, _reason(problem, error))
        known = error.check if isinstance(error, VerificationError) else None
        plan, check, why = kept, known or verify(kept), _reason(problem, error)
    return _measured(spec, plan, check, why)


def _measured(spec: Spec, plan: Plan, check: Check, why: str) -> Row:
    errors = np.abs(check.terminal_error_deg)
    row = Row(
        label=spec.label,
        method=spec.method,
        solved=plan.verified,
        why=why,
        plan=plan,
        travel_rad=plan.travel,
        duration_s=plan.duration,
        domain_margin=plan.domain.margin,
        domain_ok=plan.domain.ok,
        terminal_error_deg=float(np.max(errors)) if errors.size else np.nan,
        solve_time_s=plan.solve_time_s,
        build_time_s=plan.build_time_s,
    )
    if not plan.executable:
        return row
    peaks = peak_inputs(plan.trajectory)
    return replace(row, effort=effort(plan.trajectory), peak_u=(float(peaks[0]), float(peaks[1])))


def _replayed(
    row: Row, machine: Machine, samples: int, seed: int, part: Callable[[str, float], None]
) -> Row:
    if row.plan is None or not row.plan.executable:
        return row

    def tell(done: int, total: int) -> None:
        part("replaying", 0.5 + 0.5 * done / total)

    # Long motions are recorded more coarsely: a thousand samples are kept in memory.
    record = max(RECORD_S, row.plan.duration / 500)
    runs = run_replay(row.plan, machine, samples, seed, record_s=record, progress=tell)
    if not runs.angles:
        return replace(row, replay=runs)
    median, high = np.percentile(runs.index_E_deg, [50, 95])
    return replace(row, replay=runs, E_median_deg=float(median), E_p95_deg=float(high))


def _complete(error: NoPlanError) -> Plan | None:
    """The plan a refusal carries if it is a whole motion, not a solver's last iterate."""
    if error.plan is None or not isinstance(error, SingularError | VerificationError):
        return None
    return replace(error.plan, status=error.status, verified=False)


def _reason(problem: Problem, error: NoPlanError) -> str:
    if isinstance(error, SingularError) and error.plan is not None and error.times_s:
        return _outside(error.times_s)
    if isinstance(error, VerificationError) and error.violations:
        more = len(error.violations) - 1
        return _broken(error.violations[0]) + (f", and {more} more" if more else "")
    return error.reason.splitlines()[0].removeprefix(f"{problem.source}: ")


def _broken(violation: Violation) -> str:
    unit = f" {violation.unit}" if violation.unit else ""
    return f"{violation.label} reaches {violation.value:.3g}{unit}, allowed {violation.limit:.3g}"


def _outside(times: Sequence[float]) -> str:
    listed = ", ".join(f"{t:.3g}" for t in times[:4]) + (", ..." if len(times) > 4 else "")
    return f"leaves the chart's domain at t = {listed} s"

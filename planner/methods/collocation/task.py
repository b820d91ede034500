"""One problem on one transcription, ready to be solved from any start.

A solver's report of success is checked by evaluating the rows again.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from planner.errors import solver_answer
from planner.methods.collocation.solvers import Settings, SolverAnswer, attempts, backend
from planner.methods.collocation.transcription.bounds import Bounds, InputDemands, bounds
from planner.methods.collocation.transcription.follower import MIDDLES, PARTS
from planner.methods.collocation.transcription.form import Form, Mesh, Units, natural_units
from planner.methods.collocation.transcription.transcription import Transcription, transcription
from planner.methods.collocation.transcription.unknowns import (
    STEPS,
    Iterate,
    curve,
    pieces,
    resimulate,
    resimulated_apart,
)
from planner.plan.measures import Objective
from planner.plan.trajectory import StateTrajectory
from planner.problem.problem import Problem
from planner.problem.requirements.requirement import Requirement
from planner.support import deadline, progress
from planner.support.arrays import Array

ACCEPTED_RESIDUAL = 1e-7
"""Largest excess of a row or unknown over its bounds, in natural units, that counts as solved."""

FEASIBLE_RESIDUAL = 1e-5
"""Largest residual of a solver's last iterate at which the next solver starts from this iterate."""

SOFT_RESIDUAL = 1e-2
"""The same if the goal was only a term of the solver's objective (`Form.soft_goal`)."""

STRAYED = 0.01
"""Share by which a solution may cost more than a near start, because of a finer mesh or tighter
limits. Fatrop, which takes long steps, sometimes finds another optimum that costs far more."""


@dataclass(frozen=True, eq=False)
class Solution:
    """The result of solving a task, or an iterate that was judged without a solver.

    Attributes:
        iterate: The unknowns by name.
        objective: Value of the objective.
        residual: Largest excess of a row or unknown over its bounds, in natural units, computed
            independently of the solver.
        ok: Whether the solver finished and the residual is small enough.
        status: The status text of the solver.
        iterations: Number of iterations.
    """

    iterate: Iterate
    objective: float
    residual: float
    ok: bool
    status: str
    iterations: int


@dataclass(frozen=True, eq=False)
class Task:
    """A problem on a transcription, with everything that a solver needs.

    Attributes:
        problem: Start, goal and limits.
        requirements: The requirements that have rows, all but plain limits on u or du/dt: keeping
            them at the nodes does not ensure them between the nodes.
        objective: The objective.
        nlp: The transcription.
        mesh: The mesh.
        demands: Demands on the inputs beside the problem's limits.
        settings: Options of the solver.
        inset: Amounts by which the parts of the requirements are tightened, shape (K, R).
        build_time_s: Time to build transcription and solver, s; zero if both were cached.
    """

    problem: Problem
    requirements: list[Requirement]
    objective: Objective
    nlp: Transcription
    mesh: Mesh
    demands: InputDemands
    settings: Settings
    inset: Array
    build_time_s: float

    @property
    def bounds(self) -> Bounds:
        """Bounds of the programme's unknowns and rows, and the parameters of the programme."""
        numbers = self.mesh, self.objective, self.demands, self.inset
        return bounds(self.problem, self.requirements, self.nlp, *numbers)

    def solve(self, start: Iterate, near: bool = False) -> Solution:
        """Solve the task from a start; `near` says that the start is close to the answer.

        If the first attempt fails, the next is made; so it is if the first strays from a near start
        to a motion that costs more by the share `STRAYED` (not beside posts), and after a soft
        goal, with which Fatrop only comes near the optimum.
        """
        nlp, data, settings = self.nlp, self.bounds, replace(self.settings, near=near)
        iterations, solution, best = 0, None, None
        soft = nlp.form.soft_goal and not near
        near_enough = SOFT_RESIDUAL if soft else FEASIBLE_RESIDUAL
        bounded = near and not self.problem.divided  # beside posts any better motion will do
        most = (1 + STRAYED) * self.judge(start).objective if bounded else np.inf
        for trial in attempts(nlp, settings):
            if solution and (soft or not solution.ok) and solution.residual <= near_enough:
                start, trial = solution.iterate, replace(trial, near=True)
            deadline.check()
            progress.count(solves=1)
            packed = self._packed(start, data)
            packed = packed.clip(data.lower, data.upper)
            parts = nlp, trial, packed
            answer = solver_answer(partial(_run, *parts, data), partial(_unfinished, *parts))
            answer = replace(answer, vector=answer.vector.clip(data.lower, data.upper))
            iterations += answer.iterations
            solution = replace(_check(nlp, data, answer, ACCEPTED_RESIDUAL), iterations=iterations)
            if best is None or not best.ok or (solution.ok and solution.objective < best.objective):
                best = solution
            if solution.ok and solution.objective <= most and not soft:
                break
        assert best is not None
        progress.count(iterations=iterations)
        return replace(best, iterations=iterations)

    def solve_near(self, start: Iterate) -> Solution:
        """Solve the task from a start near the answer; if that fails, as from any other start."""
        solution = self.solve(start, near=True)
        return solution if solution.ok else self.solve(start)

    def judge(self, iterate: Iterate) -> Solution:
        """Rate an iterate without a solver; the solution is ok if all rows and bounds hold."""
        data = self.bounds
        vector = self._packed(iterate, data)
        answer = SolverAnswer(vector, True, "a motion, not the best", 0)
        return _check(self.nlp, data, answer, FEASIBLE_RESIDUAL)

    def _packed(self, iterate: Iterate, data: Bounds) -> Array:
        """Return an iterate as a vector, with the motion of a follower that belongs to it."""
        if follower := self.nlp.form.follower:
            left, right = iterate.input_ends()
            seconds = (self.mesh.widths * iterate.duration)[:, None, None]
            ways = seconds / PARTS * (left[:, None] + MIDDLES[:, None] * (right - left)[:, None])
            parts = self.nlp.system, self.problem.start, ways, self.demands.smoothing
            iterate = replace(iterate, joints=follower.run(*parts))
        return np.asarray(self.nlp.layout.pack(iterate, data.widths) / data.units)

    def curve(self, iterate: Iterate) -> StateTrajectory:
        """Return the motion that an iterate of the task describes, as a trajectory."""
        return curve(self.nlp.system, self.nlp.form, self.mesh, iterate)

    def motion(self, iterate: Iterate) -> Array:
        """Simulate the true motion under an iterate's input; return samples (K, M, N) in time."""
        nlp = self.nlp
        states = resimulate(nlp.model, self.mesh, iterate, nlp.start(self.problem))
        return states[..., : nlp.system.size]

    def motion_apart(self, iterate: Iterate) -> Array:
        """Simulate each interval from an iterate's node at its left edge; return (K, M, N)."""
        states = resimulated_apart(self.nlp.model, self.mesh, iterate)
        return states[..., : self.nlp.system.size]

    def on_mesh(self, mesh: Mesh) -> Task:
        """Return the same task on another mesh, with the limits as given, not tightened."""
        form = replace(self.nlp.form, intervals=len(mesh.widths))
        return task(self.problem, self.objective, form, mesh, self.demands, self.settings)

    def for_problem(self, problem: Problem, objective: Objective) -> Task:
        """Return the task of another problem with this task's mesh and tightened limits."""
        parts = self.nlp.form, self.mesh, self.demands, self.settings
        return replace(task(problem, objective, *parts), inset=self.inset)

    def with_inner_rows(self) -> Task:
        """Return the same task with limits on coordinates kept at the collocation points too."""
        form = replace(self.nlp.form, inner=True)
        return task(self.problem, self.objective, form, self.mesh, self.demands, self.settings)


def task(
    problem: Problem,
    objective: Objective,
    form: Form,
    mesh: Mesh,
    demands: InputDemands,
    settings: Settings,
) -> Task:
    """Prepare the task of a problem; transcription and solver are built unless cached.

    The problem determines whether the duration is an unknown, which requirements have rows, and the
    natural units. Desensitised plans use the problem's own units, since their states are
    responses to errors in these units.
    """
    every = problem.requirements
    requirements = [each for each in every if not (each.is_direct and each.reads & {"u", "du"})]
    at_edges = [each for each in (*problem.final, problem.on_the_way) if each.parts]
    rows, final = (tuple(each.template for each in group) for group in (requirements, at_edges))
    units = Units() if form.augmented else natural_units(problem, objective, demands.timeless)
    free = problem.duration is None
    form = replace(form, free_duration=free, kept=rows, final=final, units=units)
    built, began = transcription.cache_info().misses, time.perf_counter()
    nlp = transcription(problem.system, form)
    first = attempts(nlp, settings)[0]
    new = transcription.cache_info().misses > built or first not in nlp.solvers
    solver_answer(lambda: backend(nlp, first), lambda _: None)  # `Task.solve` reports its errors
    seconds = time.perf_counter() - began if new else 0.0
    none = np.zeros((form.intervals, sum(len(requirement.parts) for requirement in requirements)))
    return Task(problem, requirements, objective, nlp, mesh, demands, settings, none, seconds)


def _check(nlp: Transcription, data: Bounds, answer: SolverAnswer, accepted: float) -> Solution:
    """Convert a solver's answer to a solution; the rows are evaluated again and must hold."""
    objective, rows, iterate = nlp.outcome(answer.vector, data.parameters)
    values = np.concatenate([rows, answer.vector])
    lower = np.concatenate([data.row_lower, data.lower])
    upper = np.concatenate([data.row_upper, data.upper])
    excess = np.maximum(np.maximum(lower - values, values - upper), 0.0)
    residual = float(np.where(np.isnan(values), np.inf, excess).max())
    ok = answer.finished and residual <= accepted
    objective *= nlp.form.units.objective
    return Solution(iterate, objective, residual, ok, answer.status, answer.iterations)


def transfer(old: Task, iterate: Iterate, new: Task) -> Iterate:
    """Convert an iterate of one task to a start of a task with another mesh or kind of input."""
    q, u = pieces(old.nlp.form, old.mesh, iterate)
    mesh, T = new.mesh, iterate.duration
    return Iterate(
        duration=T,
        nodes=q(mesh.edges * T),
        points=q(mesh.at(new.nlp.form.scheme.points) * T),
        inputs=u(new.nlp.form.input_places(mesh) * T),
    )


def iterate_of_inputs(job: Task, duration: float, inputs: Array) -> Iterate:
    """Simulate inputs, shaped as `Iterate.inputs`, from the problem's start; return the iterate."""
    nlp, tau = job.nlp, job.nlp.form.scheme.points * STEPS
    shape = nlp.form.intervals, nlp.form.degree, nlp.model.size
    still = Iterate(duration, np.empty(0), np.empty(shape), inputs)
    states = resimulate(nlp.model, job.mesh, still, nlp.start(job.problem))
    before = np.minimum(tau.astype(int), STEPS - 1)
    share = (tau - before)[:, None]
    points = (1 - share) * states[:, before] + share * states[:, before + 1]
    return replace(still, nodes=np.vstack([states[:, 0], states[-1:, -1]]), points=points)


def stretch_to(iterate: Iterate, duration: float) -> Iterate:
    """Return the same path in another duration, s, still a motion since systems are driftless."""
    factor = iterate.duration / duration
    return replace(iterate, duration=duration, inputs=iterate.inputs * factor)


def _run(nlp: Transcription, settings: Settings, start: Array, data: Bounds) -> SolverAnswer:
    return backend(nlp, settings)(start, data)


def _unfinished(nlp: Transcription, settings: Settings, start: Array, words: str) -> SolverAnswer:
    """Return a failed answer with the start after an error of the solver, and forget the solver."""
    nlp.solvers.pop(settings, None)  # its state is unknown
    return SolverAnswer(start, False, f"Raised_Error: {words}", 0)

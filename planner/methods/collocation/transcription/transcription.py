"""The whole programme from one interval: CasADi functions with exact sparse derivatives.

The derivatives of one interval are formed symbolically once and mapped over all intervals. Unknowns
and rows are ordered by stages, so the nonzeros of the whole matrices are those of the intervals in
sequence: nothing is reordered, summed or differentiated again. Building takes milliseconds,
independent of the mesh.

Jacobian pattern (y: state at an edge, c: control; one block row per interval):


    y c 1
        y c 1
            y c 1

The Hessian of the Lagrangian has one block (y, c) per interval, and the Hessian of the end's cost
at the last state. The transcription of a system is built once for each form, then reused with any
numbers.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from itertools import pairwise
from typing import Any

import casadi as ca
import numpy as np

from planner.methods.collocation.transcription.augmented import MovingSystem
from planner.methods.collocation.transcription.form import Form
from planner.methods.collocation.transcription.interval import Rows, Stage, order, stage
from planner.methods.collocation.transcription.unknowns import Iterate, Layout, layout
from planner.problem.problem import Problem
from planner.support import deadline
from planner.support.arrays import Array
from planner.support.compiled_calls import Call
from planner.systems.triangular_system import TriangularSystem


@dataclass(frozen=True, eq=False)
class Program:
    """The functions of a nonlinear programme: minimise f(x, p) with bounds on x and on g(x, p).

    Attributes:
        problem: The expressions x, p, f, g; p holds `Form.parameters` numbers, then the widths
            of the K mesh intervals, then a soft goal and its penalties.
        f: Function from (x, p) to f.
        g: Function from (x, p) to g.
        gradient: Function from (x, p) to the gradient of f.
        value_gradient: Function from (x, p) to f and its gradient.
        jacobian: Function from (x, p) to g and its Jacobian.
        gradient_and_hessian: Function from (x, p, lam_f, lam_g) to the gradient and the Hessian of
            lam_f f + lam_g g.
        triangle: Function from (x, p, lam_f, lam_g) to the Hessian's upper triangle only.
        outcome: Function of arrays (x, p) to one array of f, g, and the coordinates at the
            collocation points.
    """

    problem: dict[str, Any]
    f: Any
    g: Any
    gradient: Any
    value_gradient: Any
    jacobian: Any
    gradient_and_hessian: Any
    triangle: Any
    outcome: Call


class _Assembly:
    """Builder of a programme by repeating one interval over the mesh; the unknowns are a column per
    interval, then the last state."""

    def __init__(
        self, form: Form, stage: Stage, layout: Layout, functions: IntervalFunctions
    ) -> None:
        self.K, self.ny, self.nc = layout.intervals, layout.state, layout.control
        self.height, self.m = stage.height, layout.state + layout.control
        self.functions, weights = functions, stage.weights.numel()
        goal = 2 * layout.nodes.shape[1] * form.soft_goal
        self.x, self.p = ca.MX.sym("x", layout.size), ca.MX.sym("p", weights + self.K + goal)
        self.columns = ca.reshape(self.x[: self.K * self.m], self.m, self.K)
        self.last = self.x[self.K * self.m :]
        self.end = ca.Function("end", [stage.state], [stage.end])(self.last)
        if form.soft_goal:
            aim, penalty = ca.vertsplit(self.p[weights + self.K :], goal // 2)
            self.end += ca.dot(penalty, (self.last[: goal // 2] - aim) ** 2) / 2
        widths = self.p[weights : weights + self.K]
        self.bend, self.slope = ca.hessian(self.end, self.x)
        self.parameters = ca.vertcat(ca.repmat(self.p[:weights], 1, self.K), widths.T)

    def program(self) -> Program:
        f = ca.sum2(*self._mapped(self.functions.cost)) + self.end
        g = self._rows(*self._mapped(self.functions.rows))
        (columns,), names = self._mapped(self.functions.gradient), ["x", "p"]
        gradient = ca.vertcat(ca.vec(columns), ca.MX.zeros(self.ny)) + self.slope
        (points,) = self._mapped(self.functions.points)
        outcome = ca.vertcat(f, g, ca.vec(points))
        return Program(
            problem={"x": self.x, "p": self.p, "f": f, "g": g},
            f=ca.Function("nlp_f", self._xp, [f], names, ["f"]),
            g=ca.Function("nlp_g", self._xp, [g], names, ["g"]),
            gradient=ca.Function("nlp_grad_f", self._xp, [gradient], names, ["grad_f_x"]),
            value_gradient=ca.Function(
                "nlp_grad_f", self._xp, [f, gradient], names, ["f", "grad_f_x"]
            ),
            jacobian=self._jacobian(),
            gradient_and_hessian=self._gradient_and_hessian(),
            triangle=self._triangle(),
            outcome=Call(ca.Function("outcome", self._xp, [outcome])),
        )

    @property
    def _xp(self) -> list[Any]:
        return [self.x, self.p]

    def _mapped(self, function: Any, *more: Any) -> list[Any]:
        out = function.map(self.K)(self.columns, self.parameters, *more)
        return list(out) if isinstance(out, tuple) else [out]

    def _rows(self, rows: Any) -> Any:
        """Return the rows of all intervals, with the next state added to the first rows of each."""
        following = ca.horzcat(self.columns[: self.ny, 1:], self.last)
        return ca.vec(ca.vertcat(rows[: self.ny, :] + following, rows[self.ny :, :]))

    def _jacobian(self) -> Any:
        """Build the Jacobian of g, in which states have ones in the previous interval's rows."""
        rows, nonzeros = self._mapped(self.functions.jacobian)
        one = ca.vertcat(ca.DM.eye(self.m)[: self.ny, :], ca.DM(self.height - self.ny, self.m))
        ones = ca.horzcat(ca.DM(self.K * self.height, self.m), ca.kron(ca.DM.eye(self.K), one))
        own = self._blocks(self.functions.jacobian_pattern, nonzeros)
        whole = ca.horzcat(own, ca.MX(own.size1(), self.ny)) + ones[:, : self.x.numel()]
        outputs = [self._rows(rows), whole]
        return ca.Function("nlp_jac_g", self._xp, outputs, ["x", "p"], ["g", "jac_g_x"])

    def _lagrangian(self) -> tuple[list[Any], Any, Any]:
        """Return the Lagrangian's arguments, gradient and Hessian."""
        scale, duals = ca.MX.sym("lam_f"), ca.MX.sym("lam_g", self.K * self.height)
        columns = ca.reshape(duals, self.height, self.K)
        scales = ca.repmat(scale, 1, self.K)
        gradients, nonzeros = self._mapped(self.functions.gradient_and_hessian, scales, columns)
        following = ca.vertcat(ca.MX.zeros(self.nc, self.K), columns[: self.ny, :])
        gradient = ca.vertcat(ca.vec(gradients), ca.MX.zeros(self.ny))
        gradient += ca.vertcat(ca.MX.zeros(self.ny), ca.vec(following))
        blocks = self._blocks(self.functions.hessian_pattern, nonzeros)
        hessian = ca.diagcat(blocks, ca.MX(self.ny, self.ny)) + scale * self.bend
        return [*self._xp, scale, duals], gradient + scale * self.slope, hessian

    def _gradient_and_hessian(self) -> Any:
        inputs, gradient, hessian = self._lagrangian()
        names = ["x", "p", "lam_f", "lam_g"], ["grad_gamma_x", "hess_gamma_x_x"]
        return ca.Function("nlp_hess_l", inputs, [gradient, hessian], *names)

    def _triangle(self) -> Any:
        inputs, _, hessian = self._lagrangian()
        names = ["x", "p", "lam_f", "lam_g"], ["hess_gamma_x_x"]
        return ca.Function("nlp_hess_l", inputs, [ca.triu(hessian)], *names)

    def _blocks(self, pattern: Any, nonzeros: Any) -> Any:
        """Return the matrix with a block of this pattern for each interval on its diagonal."""
        return ca.MX(ca.kron(ca.DM.eye(self.K), ca.DM(pattern, 1)).sparsity(), ca.vec(nonzeros))


@dataclass(frozen=True, eq=False)
class Transcription:
    """A nonlinear programme with named unknowns, for any start, goal, limits, mesh and weights.

    Attributes:
        system: The system.
        model: The transcribed system: the system itself or an `Augmented` one.
        form: The properties of the transcription.
        layout: Positions of the unknowns.
        labels: Meaning of the rows of one interval.
        height: Number of rows of one interval.
        program: The functions.
        solvers: Cached solvers for this transcription, by their settings.
    """

    system: TriangularSystem
    model: MovingSystem
    form: Form
    layout: Layout
    labels: tuple[Rows, ...]
    height: int
    program: Program
    solvers: dict[Any, Any] = field(default_factory=dict)

    def start(self, problem: Problem) -> Array:
        """Return the state at a problem's start; states other than coordinates are zero there."""
        return np.append(problem.start, np.zeros(self.model.size - self.system.size))

    def outcome(self, vector: Array, parameters: Array) -> tuple[float, Array, Iterate]:
        """Evaluate the programme at a vector of unknowns in natural units.

        Returns:
            The objective and the values of all rows, in natural units; and the unknowns by name, in
            the problem's units, with the collocation values that follow from them.
        """
        at, units = self.layout, self.form.units
        duration = units.time_s * parameters[self.form.parameters - 1]
        values = self.program.outcome(vector, parameters)
        end = 1 + at.intervals * self.height
        rows, points = values[1:end], values[end:]
        vector = vector * at.units(units)
        iterate = Iterate(
            duration=float(vector[at.durations[0]] if self.form.free_duration else duration),
            nodes=vector[at.nodes],
            points=points.reshape(at.intervals, self.form.degree, -1),
            inputs=vector[at.inputs],
            joints=vector[at.joints],
        )
        return float(values[0]), rows, iterate


@lru_cache(maxsize=24)  # up to 25 MB each, solvers included, on the meshes of five joints
def transcription(system: TriangularSystem, form: Form) -> Transcription:
    """Build the transcription of a system for a form, cached.

    Raises:
        TimeUpError: If time is up before the transcription is built.
    """
    model = form.augmented or system
    dependencies = order(model)
    places = layout(form, model.size, dependencies.lifted)
    symbols = stage(system, form, dependencies)
    functions = interval_functions(symbols)
    return Transcription(
        system=system,
        model=model,
        form=form,
        layout=places,
        labels=symbols.labels,
        height=symbols.height,
        program=_Assembly(form, symbols, places, functions).program(),
    )


@dataclass(frozen=True, eq=False)
class IntervalFunctions:
    """CasADi functions of one interval, with the column (y, c), state and control, and parameters.

    The parameters are those of `Form.parameters`, then the interval's width.

    Attributes:
        cost: Gives the cost.
        rows: Gives the rows, the first being minus the next state.
        gradient: Gives the gradient of the cost.
        jacobian: Gives the rows, and the nonzeros of their Jacobian by columns.
        gradient_and_hessian: With lam_f and lam_g also as arguments, gives the gradient of the
            Lagrangian and the nonzeros of its Hessian.
        points: Gives the coordinates at the collocation points.
        jacobian_pattern: Sparsity of the Jacobian.
        hessian_pattern: Sparsity of the Hessian, both triangles.
    """

    cost: Any
    rows: Any
    gradient: Any
    jacobian: Any
    gradient_and_hessian: Any
    points: Any
    jacobian_pattern: Any
    hessian_pattern: Any


def interval_functions(stage: Stage) -> IntervalFunctions:
    """Build the functions of one interval with their first and second derivatives.

    Raises:
        TimeUpError: If time is up; eight joints with their response to errors take a second.
    """
    unknowns = ca.vertcat(stage.state, stage.control)
    inputs = [unknowns, ca.vertcat(stage.weights, stage.width)]
    rows = ca.vertcat(-stage.after, stage.rows)
    scale, duals = ca.SX.sym("scale"), ca.SX.sym("duals", stage.height)
    chain = ChainRule(unknowns, stage.inside, stage.meaning)
    gradient, hessian = chain.second(scale * stage.cost + ca.dot(duals, rows))
    jacobian = chain.jacobian(rows)
    return IntervalFunctions(
        cost=_function(chain, "cost", inputs, [stage.cost]),
        rows=_function(chain, "rows", inputs, [rows]),
        gradient=_function(chain, "gradient", inputs, [chain.jacobian(stage.cost).T]),
        jacobian=_function(chain, "jacobian", inputs, [rows, jacobian.nz[:]]),
        gradient_and_hessian=_function(
            chain, "hessian", [*inputs, scale, duals], [gradient, hessian.nz[:]]
        ),
        points=_function(chain, "points", inputs, [ca.vec(stage.points)]),
        jacobian_pattern=jacobian.sparsity(),
        hessian_pattern=hessian.sparsity(),
    )


def _function(chain: ChainRule, name: str, inputs: list[Any], outputs: list[Any]) -> Any:
    deadline.check()
    outputs = ca.cse([ca.densify(out) for out in chain.substitute(outputs)])
    return ca.Function(f"interval_{name}", inputs, outputs)


class ChainRule:
    """Derivatives by w of functions L(w, v), where v is defined step by step: v = F(w, earlier v).

    Let Z = dv/dw, and mu the total derivatives of a function L(w, v) by each v, including the
    effect on later entries of v. Then L has the Hessian (I; Z)' M (I; Z), where M is the Hessian of
    L + mu' F in (w, v). M is sparse, since the collocation points are not coupled in it. This takes
    half the operations of differentiating L after substituting v. With substitution, by CasADi
    alone, five shipped problems took 10 to 30 % more processor time in total when desensitised, and
    3 to 7 % more with collocation.

    Args:
        unknowns: w, a column.
        inside: v, as columns of symbols.
        meaning: F, as columns, each in terms of w and of earlier columns of v.
    """

    def __init__(self, unknowns: Any, inside: Sequence[Any], meaning: Sequence[Any]) -> None:
        self.w, self.v, self.F = unknowns, ca.vertcat(*inside), ca.vertcat(*meaning)
        self.by_v = ca.jacobian(self.F, self.v)
        self.ends = np.cumsum([0, *(column.numel() for column in inside)]).tolist()
        rows = ca.vertsplit(ca.jacobian(self.F, self.w), self.ends)
        for k, (first, last) in enumerate(pairwise(self.ends)):
            if k > 0:
                rows[k] += self.by_v[first:last, :first] @ ca.vertcat(*rows[:k])
        self.Z = ca.vertcat(*rows)

    def jacobian(self, value: Any) -> Any:
        """Return the Jacobian by w of a column `value` in w and v, with a row for each entry."""
        return ca.jacobian(value, self.w) + ca.jacobian(value, self.v) @ self.Z

    def second(self, of: Any) -> tuple[Any, Any]:
        """Return the gradient and the Hessian by w of a scalar function of w and v."""
        mu, count = ca.SX.sym("mu", self.v.numel()), self.w.numel()
        whole = of + ca.dot(mu, self.F)
        hessian = ca.hessian(whole, ca.vertcat(self.w, self.v))[0]
        mixed = hessian[:count, count:] @ self.Z
        direct = hessian[:count, :count] + self.Z.T @ (hessian[count:, count:] @ self.Z)
        both = [ca.gradient(whole, self.w), ca.triu2symm(ca.triu(direct + mixed + mixed.T))]
        gradient, hessian = ca.substitute(both, [mu], [self._growth(of)])
        return gradient, hessian

    def _growth(self, of: Any) -> Any:
        out = ca.vertsplit(ca.gradient(of, self.v), self.ends)
        for k, (first, last) in reversed(list(enumerate(pairwise(self.ends[:-1])))):
            out[k] += self.by_v[last:, first:last].T @ ca.vertcat(*out[k + 1 :])
        return ca.densify(ca.vertcat(*out))

    def substitute(self, outputs: list[Any]) -> list[Any]:
        """Return the expressions with the definitions F substituted for the symbols v."""
        return list(ca.substitute_inplace(ca.vertsplit(self.v), ca.vertsplit(self.F), outputs)[1])

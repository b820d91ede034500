"""The same problems put to general frameworks: rockit, do-mpc, Drake and mpopt.

All but Drake write the programme for CasADi. They come with the extra `rivals`, but for
Drake, which has packages for few systems, and mpopt, whose package asks for a NumPy of 2021:
`pip install --no-deps mpopt`. What is not installed is left out.
Each gets 40 intervals, as `rivals` does: Radau points of degree 3 with constant inputs, or (rockit
with Fatrop) one Runge-Kutta step an interval. Drake has cubic pieces with linear inputs; mpopt gets
40 pieces of degree 3 with inputs of the same degree. All start from the straight line, mpopt from
its own. As in `rivals`, the call is timed that solves once what was written down before.
"""

from __future__ import annotations

import contextlib
import io
import time
import warnings
from collections.abc import Callable, Iterator
from importlib.util import find_spec
from typing import Any

import casadi as ca
import numpy as np
from rivals import DEGREE, K_INTERVALS, TOLERANCE, Arm, Outcome

IPOPT = {"ipopt": {"print_level": 0, "sb": "yes", "tol": TOLERANCE}, "print_time": False}
FATROP = {
    "fatrop": {"print_level": 0, "tol": TOLERANCE},
    "structure_detection": "auto",
    "print_time": False,
}
EXTRA = {"rockit": "rockit-meco", "do_mpc": "do-mpc", "pydrake": "drake", "mpopt": "mpopt"}


def missing() -> list[str]:
    """Packages that are not installed."""
    return [package for module, package in EXTRA.items() if find_spec(module) is None]


def frameworks(arm: Arm) -> dict[str, Callable[[], Callable[[], Outcome]]]:
    """Makers of calls, by name, of what is installed."""
    makers: dict[str, tuple[str, Callable[[], Callable[[], Outcome]]]] = {
        "rockit + IPOPT": ("rockit", lambda: by_rockit(arm, "ipopt")),
        "rockit + Fatrop": ("rockit", lambda: by_rockit(arm, "fatrop")),
        "do-mpc + IPOPT": ("do_mpc", lambda: by_do_mpc(arm)),
        "Drake + SNOPT": ("pydrake", lambda: by_drake(arm, "SnoptSolver")),
        "Drake + IPOPT": ("pydrake", lambda: by_drake(arm, "IpoptSolver")),
        "mpopt + IPOPT": ("mpopt", lambda: by_mpopt(arm)),
    }
    return {name: make for name, (module, make) in makers.items() if find_spec(module)}


def by_rockit(arm: Arm, solver: str) -> Callable[[], Outcome]:
    """Rockit: Radau collocation with IPOPT, or multiple shooting with Fatrop, as it advises."""
    with _quiet():
        import rockit

        ocp = rockit.Ocp(T=arm.duration)
        q, u = ocp.state(arm.size), ocp.control(2)
        ocp.set_der(q, arm.rates(q, u))
        ocp.add_objective(ocp.integral(ca.sumsqr(u)))
        ocp.subject_to(ocp.at_t0(q) == arm.start)
        ocp.subject_to(ocp.at_tf(q[1:]) == arm.goal[1:])
        ocp.subject_to((-arm.input_limit <= (u <= arm.input_limit)), include_last=False)
        inside = {"include_first": False, "include_last": False}
        ocp.subject_to(-arm.joint_limit <= (q[1:] <= arm.joint_limit), **inside)
        if arm.z2 is not None:
            ocp.subject_to(arm.z2_of(q) <= -arm.z2, **inside)
        states, inputs = _guess(arm)
        edges = np.linspace(0.0, arm.duration, K_INTERVALS + 1).tolist()
        line = ca.interpolant("line", "linear", [edges], states.ravel())
        ocp.set_initial(q, line(ocp.t))  # of numbers its collocation (0.6.7) makes a NameError
        ocp.set_initial(u, inputs.T)
        if solver == "ipopt":
            ocp.solver("ipopt", {"expand": True, **IPOPT})
            ocp.method(rockit.DirectCollocation(N=K_INTERVALS, degree=DEGREE, scheme="radau"))
        else:
            ocp.solver("fatrop", {"expand": True, **FATROP})
            ocp.method(rockit.MultipleShooting(N=K_INTERVALS, M=1, intg="rk"))

    def solve() -> Outcome:
        with _quiet():
            began = time.process_time()
            try:
                found = ocp.solve()
            except RuntimeError:  # it has not converged
                return Outcome(time.process_time() - began, np.nan, 0)
            seconds = time.process_time() - began
            values = found.sample(u, grid="control")[1][:-1]
            count = int(found.stats["iter_count"])
            return Outcome(seconds, float(found.value(ocp.objective)), count, values[:, None])

    return solve


def by_do_mpc(arm: Arm) -> Callable[[], Outcome]:
    """One optimisation of do-mpc's controller, over the whole motion."""
    h = arm.duration / K_INTERVALS
    with _quiet():
        import do_mpc

        model = do_mpc.model.Model("continuous")
        q = model.set_variable("_x", "q", (arm.size, 1))
        u = model.set_variable("_u", "u", (2, 1))
        model.set_rhs("q", arm.rates(q, u))
        model.setup()
        mpc = do_mpc.controller.MPC(model)
        mpc.settings.n_horizon, mpc.settings.t_step = K_INTERVALS, h
        mpc.settings.collocation_deg, mpc.settings.collocation_type = DEGREE, "radau"
        mpc.settings.store_full_solution = False
        mpc.settings.nlpsol_opts = IPOPT
        mpc.set_objective(mterm=ca.DM(0), lterm=h * ca.sumsqr(u))
        mpc.set_rterm(u=0.0)
        high = np.append(np.inf, np.full(arm.size - 1, arm.joint_limit))
        for side, sign in (("lower", -1), ("upper", 1)):
            mpc.bounds[side, "_x", "q"] = sign * high
            mpc.bounds[side, "_u", "u"] = sign * arm.input_limit
            mpc.terminal_bounds[side, "q"] = np.append(sign * np.inf, arm.goal[1:])
        if arm.z2 is not None:
            mpc.set_nl_cons("z2", arm.z2_of(q), ub=-arm.z2)
        mpc.setup()
    _, inputs = _guess(arm)

    def solve() -> Outcome:
        mpc.x0 = arm.start
        mpc.set_initial_guess()
        for k in range(K_INTERVALS):
            mpc.opt_x_num["_u", k, 0] = inputs[k]
            for j, t in enumerate([0.0, *ca.collocation_points(DEGREE, "radau"), 1.0]):
                mpc.opt_x_num["_x", k + 1, 0, j] = arm.guess((k + t) / K_INTERVALS)[0]
        mpc.opt_p_num["_x0"] = arm.start
        with _quiet():
            began = time.process_time()
            mpc.solve()
            seconds = time.process_time() - began
        stats = mpc.solver_stats
        if not stats["success"]:
            return Outcome(seconds, np.nan, int(stats["iter_count"]))
        values = np.array([mpc.opt_x_num["_u", k, 0].full().ravel() for k in range(K_INTERVALS)])
        objective = float(stats["iterations"]["obj"][-1])
        return Outcome(seconds, objective, int(stats["iter_count"]), values[:, None])

    return solve


def by_drake(arm: Arm, solver: str) -> Callable[[], Outcome]:
    """Drake's direct collocation of a system in its symbols."""
    import pydrake.all as drake
    from pydrake import symbolic

    h = arm.duration / K_INTERVALS
    q = [symbolic.Variable(f"q{k}") for k in range(arm.size)]
    u = [symbolic.Variable(f"u{k}") for k in range(2)]
    rates = arm.rate_list(q, u, symbolic.cos)
    system = drake.SymbolicVectorSystem(state=q, input=u, dynamics=rates)
    context = system.CreateDefaultContext()
    job = drake.DirectCollocation(system, context, K_INTERVALS + 1, h, h)
    programme = job.prog()
    high = np.append(np.inf, np.full(arm.size - 1, arm.joint_limit))
    for k in range(K_INTERVALS + 1):
        programme.AddBoundingBoxConstraint(-arm.input_limit, arm.input_limit, job.input(k))
        programme.AddBoundingBoxConstraint(-high, high, job.state(k))
        if arm.z2 is not None:
            z2 = arm.z2_of(job.state(k), symbolic)
            programme.AddConstraint(z2, -np.inf, -arm.z2)
    programme.AddBoundingBoxConstraint(arm.start, arm.start, job.initial_state())
    programme.AddBoundingBoxConstraint(arm.goal[1:], arm.goal[1:], job.final_state()[1:])
    job.AddRunningCost(job.input()[0] ** 2 + job.input()[1] ** 2)
    times = np.linspace(0.0, arm.duration, K_INTERVALS + 1)
    line = [arm.guess(k / K_INTERVALS) for k in range(K_INTERVALS + 1)]
    hold = drake.PiecewisePolynomial.FirstOrderHold
    job.SetInitialTrajectory(
        hold(times, np.array([u for _, u in line]).T), hold(times, np.array([q for q, _ in line]).T)
    )
    options = drake.SolverOptions()
    options.SetOption(drake.SnoptSolver.id(), "Major optimality tolerance", TOLERANCE)
    options.SetOption(drake.SnoptSolver.id(), "Major feasibility tolerance", TOLERANCE)
    options.SetOption(drake.IpoptSolver.id(), "tol", TOLERANCE)
    engine = getattr(drake, solver)()

    def solve() -> Outcome:
        began = time.process_time()
        found = engine.Solve(programme, None, options)
        seconds = time.process_time() - began
        if not found.is_success():
            return Outcome(seconds, np.nan, 0)
        values = found.GetSolution(np.array([job.input(k) for k in range(K_INTERVALS + 1)]))
        pieces = np.stack([values[:-1], values[1:]], axis=1)
        return Outcome(seconds, float(found.get_optimal_cost()), 0, pieces, edges=times)

    return solve


def by_mpopt(arm: Arm) -> Callable[[], Outcome]:
    """Mpopt: pseudospectral pieces whose inputs are polynomials too."""
    with _quiet():
        from mpopt import mp

        ocp = mp.OCP(n_states=arm.size, n_controls=2)
        ocp.dynamics[0] = lambda x, u, t: ca.vertsplit(arm.rates(x, u))
        ocp.running_costs[0] = lambda x, u, t: u[0] ** 2 + u[1] ** 2
        goal = arm.goal
        ocp.terminal_constraints[0] = lambda xf, tf, x0, t0: [
            xf[i] - goal[i] for i in range(1, arm.size)
        ]
        if arm.z2 is not None:
            ocp.path_constraints[0] = lambda x, u, t: [arm.z2_of(x) + arm.z2]
        high = np.append(np.inf, np.full(arm.size - 1, arm.joint_limit))
        ocp.lbx[0], ocp.ubx[0] = -high, high
        ocp.lbu[0], ocp.ubu[0] = -arm.input_limit, arm.input_limit
        ocp.x00[0], ocp.xf0[0] = arm.start, arm.goal
        ocp.u00[0], ocp.uf0[0] = arm.guess(0.0)[1], arm.guess(1.0)[1]
        ocp.tf0[0] = ocp.lbtf[0] = ocp.ubtf[0] = arm.duration
        ocp.validate()
        solver = mp.mpopt(ocp, K_INTERVALS, DEGREE, "LGR")
        options = {"ipopt.tol": TOLERANCE, "ipopt.acceptable_tol": TOLERANCE}
        solver.create_solver("ipopt", options)
    points = K_INTERVALS * DEGREE + 1

    def solve() -> Outcome:
        with _quiet():
            began = time.process_time()
            found = solver.solve()
            seconds = time.process_time() - began
        stats = solver.nlp_solver.stats()
        if not stats["success"]:
            return Outcome(seconds, np.nan, int(stats["iter_count"]))
        x = np.asarray(found["x"]).ravel()
        u = x[points * arm.size :][: 2 * points].reshape(2, points).T
        pieces = np.arange(K_INTERVALS)[:, None] * DEGREE + np.arange(DEGREE + 1)
        low, high = solver.tau0, solver.tau1
        shares = (np.asarray(solver.collocation.roots[DEGREE]) - low) / (high - low)
        count = int(stats["iter_count"])
        return Outcome(seconds, float(found["f"]), count, u[pieces], shares)

    return solve


def _guess(arm: Arm) -> tuple[Any, Any]:
    """The straight line at the edges, shape (K + 1, N), and inputs amid the pieces, (K, 2)."""
    states = [arm.guess(k / K_INTERVALS)[0] for k in range(K_INTERVALS + 1)]
    inputs = [arm.guess((k + 0.5) / K_INTERVALS)[1] for k in range(K_INTERVALS)]
    return np.array(states), np.array(inputs)


@contextlib.contextmanager
def _quiet() -> Iterator[None]:
    """Without what they print and warn of."""
    with warnings.catch_warnings(), contextlib.redirect_stdout(io.StringIO()):
        warnings.simplefilter("ignore")
        yield

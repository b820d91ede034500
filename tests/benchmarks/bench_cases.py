"""The problems of the collocation benchmark, for `planner` and as plain numbers."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from rivals import Arm
from scipy.integrate import solve_ivp

import planner
from planner.methods.collocation.guesses import likely_travel
from planner.methods.collocation.transcription.form import Mesh
from planner.methods.collocation.transcription.unknowns import Iterate

PROBLEMS = Path(__file__).parents[2] / "problems"
RHO = 0.711625 / 0.870125


@dataclass
class Case:
    """A problem, one next to it, and the problem for scripts."""

    name: str
    what: str
    problem: planner.Problem
    neighbour: planner.Problem

    @property
    def arm(self) -> Arm:
        p = self.problem
        goal = p.goal.copy()
        goal[0] = p.start[0] + likely_travel(p)  # where the first guess goes; the travel is free
        system: Any = p.system
        return Arm(
            K=list(system.K),
            k_g=system.k_g,
            start=p.start,
            goal=goal,
            duration=float(p.duration or 0),
            input_limit=float(p.limits.input[0]),
            joint_limit=float(p.limits.joint[1]),
            z2=p.limits.z2_margin,
        )


@lru_cache(maxsize=1)
def cases() -> list[Case]:
    """The four problems."""
    paper = planner.load_problem(PROBLEMS / "paper.toml")
    biting = paper.changed(
        {
            "start.theta_deg": [10, 10, 10],
            "goal.theta_deg": [10, 10, 30],
            "goal.duration": 24.0,
            "limits": {"input_rad_s": 0.2, "joint_deg": 80, "z2_margin": 0.25},
        }
    )
    crossing = planner.load_problem(PROBLEMS / "crossing.toml")
    six = chain(6)
    return [
        Case("paper", "the paper's", paper, paper.changed({"goal.theta_deg": [31, 30, 29]})),
        Case(
            "limits",
            "z2 and both inputs at their limits",
            biting,
            biting.changed({"goal.theta_deg": [10, 10, 29.5]}),
        ),
        Case(
            "crossing",
            "theta1 and theta2 change sign",
            crossing,
            crossing.changed({"goal.theta_deg": [-24, 20, 30]}),
        ),
        Case("six", "six joints", six, six.changed({"goal.theta_deg": _nudged(six)})),
    ]


def chain(joints: int) -> planner.Problem:
    """From all joints at 5 degrees to where a gentle motion of 20 s leads."""
    K = [0.870125 * RHO**i for i in range(joints - 1)]
    system = planner.Manipulator(K, 0.668811)
    start = np.append(0.0, np.deg2rad(np.full(joints, 5.0)))
    end = np.rad2deg(_moved(system, start, np.array([20.0]))[-1, 1:])
    return planner.Problem.from_dict(
        {
            "title": f"{joints} joints",
            "system": {"kind": "manipulator", "joints": joints, "K": K, "k_g": 0.668811},
            "start": {"theta_deg": [5.0] * joints},
            "goal": {"theta_deg": np.round(end, 1).tolist(), "travel": "free", "duration": 20.0},
            "limits": {"input_rad_s": 0.5, "joint_deg": 80},
        }
    )


def gentle(t: Any) -> Any:
    """Inputs of a gentle motion, shape (m, 2), at times t (m,)."""
    return np.stack([0.05 + 0 * t, 0.02 + 0.06 * np.sin(2 * np.pi * t / 20)], axis=-1)


def _moved(system: Any, start: Any, times: Any) -> Any:
    """States at increasing times under the gentle inputs, shape (m, N)."""
    rates = lambda t, q: system.rates(q, gentle(t))  # noqa: E731
    return solve_ivp(rates, (0, times[-1]), start, t_eval=times, rtol=1e-9).y.T


def along(problem: planner.Problem, mesh: Mesh) -> Iterate:
    """The gentle motion itself on a mesh."""
    T = float(problem.duration or 0)
    nodes = _moved(problem.system, problem.start, mesh.edges * T)
    points = np.repeat(nodes[:-1, None], 3, axis=1)
    return Iterate(T, nodes, points, gentle(mesh.edges * T))


def _nudged(problem: planner.Problem) -> list[float]:
    goal = np.rad2deg(problem.goal[1:])
    goal[0] += 0.5
    return [float(angle) for angle in np.round(goal, 1)]

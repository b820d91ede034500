"""The shared suite: each pair gives a verified plan or an honest refusal, as tabled here.

Whatever can be executed is replayed on the ideal machine, whose integrator and kinematics are
other code than both the method's and the verifier's.
"""

from pathlib import Path

import numpy as np
import pytest

import planner
from planner.methods.keeping import not_promised
from planner.solve import solve_and_check

PROBLEMS = Path(__file__).parents[2] / "problems"
METHODS = ("polynomial", "piecewise", "sinusoid", "sinusoid_steps", "collocation", "convex")
SOLVED, LIMIT, CHART, NONE, OPEN, UNABLE = (
    "solved",
    "verification_failed",
    "singular",
    "infeasible",
    "not_converged",
    "no_plan",
)
EXPECTED = {
    "ball-gear": (SOLVED, SOLVED, SOLVED, LIMIT, SOLVED, SOLVED),
    "car": (SOLVED, SOLVED, SOLVED, LIMIT, SOLVED, SOLVED),
    "coin": (SOLVED, LIMIT, SOLVED, LIMIT, SOLVED, SOLVED),
    "crossing": (CHART, CHART, CHART, CHART, SOLVED, CHART),
    "custom": (SOLVED, SOLVED, LIMIT, LIMIT, SOLVED, SOLVED),
    "four-joint": (CHART, CHART, CHART, CHART, SOLVED, OPEN),
    "front-axle": (SOLVED, SOLVED, SOLVED, SOLVED, SOLVED, SOLVED),
    "obstacle": (LIMIT, LIMIT, LIMIT, LIMIT, SOLVED, LIMIT),
    "paper": (LIMIT, LIMIT, SOLVED, LIMIT, SOLVED, SOLVED),
    "paper-fig4": (CHART, CHART, LIMIT, LIMIT, SOLVED, NONE),
    "paper-fig5": (CHART, CHART, LIMIT, LIMIT, SOLVED, NONE),
    "parking": (CHART, CHART, CHART, CHART, SOLVED, NONE),
    "self-collision": (UNABLE, UNABLE, UNABLE, UNABLE, SOLVED, UNABLE),
    "tip": (UNABLE, UNABLE, UNABLE, UNABLE, SOLVED, UNABLE),
    "trailers": (SOLVED, SOLVED, LIMIT, LIMIT, SOLVED, SOLVED),
    "unicycle": (SOLVED, SOLVED, LIMIT, LIMIT, SOLVED, SOLVED),
    "unreachable": (NONE, NONE, NONE, NONE, NONE, NONE),
    "waypoint": (LIMIT, LIMIT, LIMIT, LIMIT, SOLVED, LIMIT),
    "z2-limit": (CHART, CHART, LIMIT, LIMIT, SOLVED, NONE),
    "z2-singular": (CHART, CHART, SOLVED, CHART, SOLVED, SOLVED),
    "z2-singular-free": (LIMIT, LIMIT, CHART, CHART, SOLVED, SOLVED),
}


def test_the_table_is_complete() -> None:
    assert {path.stem for path in PROBLEMS.glob("*.toml")} == set(EXPECTED)
    assert all(path.read_text("utf-8").startswith("#") for path in PROBLEMS.glob("*.toml"))
    # what refines another plan finds one where that does: tests/methods/test_desensitised
    assert set(METHODS) == {name for name, m in planner.METHODS.items() if m.refines is None}


PAIRS = [(name, method) for method in METHODS for name in sorted(EXPECTED)]
# The longest searches of these two laws, which end as on problems that are left.
# "paper" by the first of them is in tests/methods/laws/test_sinusoid.py.
LONG = {
    "sinusoid": "custom four-joint front-axle obstacle paper paper-fig4 trailers waypoint z2-limit",
    "sinusoid_steps": "custom four-joint front-axle obstacle paper paper-fig4 parking trailers"
    " waypoint z2-limit",
}
# The longest searches are done once, with the same assertions: tests/methods/collocation/
# test_places.py and test_links_apart.py.
PAIRS.remove(("obstacle", "collocation"))
PAIRS.remove(("self-collision", "collocation"))


@pytest.mark.parametrize(
    ("name", "method"),
    [
        pytest.param(
            *pair, marks=[pytest.mark.campaign] if pair[0] in LONG.get(pair[1], "").split() else []
        )
        for pair in PAIRS
    ],
)
def test_pair(name: str, method: str) -> None:
    """Changes are not tried, which would take as long again: tests/methods/test_advice.py does."""
    problem = planner.load_problem(PROBLEMS / f"{name}.toml")
    reason, broken = "", ()
    try:
        plan, _ = solve_and_check(problem, method, advice=False)
        status = plan.status
    except planner.NoPlanError as error:
        status, reason, plan, broken = error.status, error.reason, error.plan, error.violations
    assert problem.name
    assert status == EXPECTED[name][METHODS.index(method)], reason
    assert (problem.source in reason) == (status != SOLVED)
    if status == LIMIT:  # a method breaks only what it never promised to keep
        assert {v.label for v in broken} <= {*not_promised(problem, planner.METHODS[method].keeps)}
    if plan is None:
        return
    assert plan.verified == (status == SOLVED)
    # the other systems' ideal replays are in tests/machine/test_direct.py
    if status in (SOLVED, LIMIT) and plan.executable and problem.system.kind == "manipulator":
        run = planner.replay(plan, planner.Machine.ideal(step_s=0.01), record_s=None)
        assert np.max(np.abs(run.terminal_error)) < 1e-6

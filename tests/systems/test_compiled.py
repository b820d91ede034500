"""The inverse compiled into one function is the same inverse, step by step."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from every_system import NAMES, SYSTEMS

from planner import chained_form


@pytest.mark.parametrize("name", NAMES)
def test_same_as_step_by_step(name: str) -> None:
    system = SYSTEMS[name]
    form, rng = chained_form(system), np.random.default_rng(3)
    start = rng.uniform(0.2, 1.2, system.size) * rng.choice([-1, 1], system.size)
    branch = system.branch(start)
    q = np.sign(start) * rng.uniform(0.1, 1.3, (200, system.size))
    z, v = form.z(q), rng.uniform(-1, 1, (200, 2))
    z[100:] += rng.uniform(-0.3, 0.3, (100, system.size))  # in and out of the domain
    stepwise = form._invert(z, branch)
    np.testing.assert_allclose(form.q(z, branch), stepwise, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(
        form.inputs(z, v, branch), form.u(form.q(z, branch), v), rtol=1e-9, atol=1e-12
    )
    compiled = not name.startswith("custom")
    assert (form._inputs is not None) == compiled


@pytest.mark.parametrize("name", ["manipulator-3", "trailers-2", "custom-manipulator-3"])
def test_the_expressions_are_the_same_inverse_where_there_is_one(name: str) -> None:
    system = SYSTEMS[name]
    form, branch = chained_form(system), system.branch(np.full(system.size, 0.4))
    q, v = np.linspace(0.2, 0.6, system.size), np.array([0.3, -0.7])
    z, u = form.z(q), form.u(q, v)
    found = (
        form.q_expr(ca.DM(z), ca.DM(branch)),
        form.inputs_expr(ca.DM(z), ca.DM(v), ca.DM(branch)),
    )
    if name.startswith("custom"):
        assert found == (None, None)
        return
    for expression, value in zip(found, (q, u), strict=True):
        np.testing.assert_allclose(np.array(expression).ravel(), value, rtol=1e-10)

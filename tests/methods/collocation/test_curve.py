"""The motion that an iterate describes."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, Literal

import numpy as np
import pytest

from planner import Manipulator
from planner.methods.collocation import refusals as collocation_refusals
from planner.methods.collocation.best import Candidate
from planner.methods.collocation.transcription.form import Form, Kind, Mesh
from planner.methods.collocation.transcription.unknowns import Iterate, curve

MESH = Mesh(np.array([0.0, 0.2, 0.7, 1.0]))


@pytest.mark.parametrize("kind", ["radau", "legendre"])
@pytest.mark.parametrize("kind_of_input", ["constant", "linear"])
def test_the_curve_passes_the_nodes_the_points_and_the_inputs(
    kind: Kind, kind_of_input: Literal["constant", "linear"]
) -> None:
    system, rng, degree = Manipulator([0.9], 0.7), np.random.default_rng(1), 3
    form = Form(3, kind, degree, input=kind_of_input)
    points, nodes = rng.normal(size=(3, degree, 3)), rng.normal(size=(4, 3))
    for k in range(3):  # an interval ends where the polynomial through node and points does
        nodes[k + 1] = form.scheme.bernstein[-1] @ np.concatenate([nodes[k : k + 1], points[k]])
    inputs = rng.normal(size=(3 + (kind_of_input == "linear"), 2))
    T = 4.0
    motion = curve(system, form, MESH, Iterate(T, nodes, points, inputs))
    np.testing.assert_allclose(motion.q(MESH.edges * T), nodes, atol=1e-12)
    at = MESH.at(form.scheme.points) * T
    np.testing.assert_allclose(motion.q(at), points, atol=1e-12)
    places = MESH.edges if kind_of_input == "linear" else MESH.at(np.array([0.3]))[:, 0]
    np.testing.assert_allclose(motion.u(places * T), inputs, atol=1e-12)


def test_an_iterate_that_has_run_away_is_no_plan_to_study() -> None:
    """A solver may end at a duration that is no number: the refusal must not fail over it."""
    iterate = Iterate(np.nan, np.zeros((4, 3)), np.zeros((3, 3, 3)), np.zeros((3, 2)))
    none: Any = None
    solution: Any = SimpleNamespace(iterate=iterate)
    assert collocation_refusals.iterate_plan(none, Candidate(none, solution), none) == (None, [])

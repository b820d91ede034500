"""The paper's example with the constants exactly as its printed z(0) gives them."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

import planner
from planner.methods.convex.paths import Frame, input_shape


def printed_constants() -> tuple[float, float]:
    """K₂ and K₃ from z(0) = (−0.0324, 0.7113, …) at one degree."""
    c, s = np.cos(np.deg2rad(1)), np.sin(np.deg2rad(1))
    K3 = 0.7113 / c**3
    return 0.0324 / (3 * K3 * c**4 * s), K3


@pytest.fixture(scope="session")
def printed(paper: planner.Problem) -> planner.Problem:
    return paper.changed({"system.K": list(printed_constants())})


@pytest.fixture(scope="session")
def frame_at(printed: planner.Problem) -> Callable[..., Frame]:
    """Frames of the example: (travel, pieces, degree) → Frame."""
    form = planner.chained_form(printed.system)
    start, goal = form.z(printed.start), form.z(np.nan_to_num(printed.goal))

    def make(travel: float, pieces: int = 60, degree: int = 0) -> Frame:
        return Frame(input_shape(pieces, degree), start, goal, 1.0).at(travel)

    return make

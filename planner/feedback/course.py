"""What the tracker follows: a plan, and a run-up before it where there is one."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from planner.plan import Plan
from planner.systems.base import Array


@dataclass(frozen=True, eq=False)
class RunUp:
    """A motion before the plan's start that ends where and as the plan begins.

    Attributes:
        t: Increasing times (m+1,), s; the last is 0.
        q: Coordinates then, (m+1, N).
        u: Inputs between them, (m, 2).
    """

    t: Array
    q: Array
    u: Array


@dataclass(frozen=True, eq=False)
class Course:
    """Coordinates and inputs to follow, at any time; the plan starts at 0.

    Attributes:
        plan: The plan.
        run_up: What comes before it, if anything.
    """

    plan: Plan
    run_up: RunUp | None = None

    @property
    def lead_s(self) -> float:
        """How long before the plan it starts, s."""
        return 0.0 if self.run_up is None else float(-self.run_up.t[0])

    def q(self, t: Array) -> Array:
        """Coordinates (…, N) at times t (…); at rest before and after."""
        out = self.plan.q(t)
        if self.run_up is None:
            return out
        before = np.stack(
            [np.interp(t, self.run_up.t, column) for column in self.run_up.q.T], axis=-1
        )
        return np.where((t < 0)[..., None], before, out)

    def u(self, t: Array) -> Array:
        """Inputs (…, 2) at times t (…); zero before and after."""
        out = self.plan.u(t)
        if self.run_up is None:
            return out
        index = np.searchsorted(self.run_up.t, t, side="right") - 1
        on = (index >= 0) & (t < 0)
        before = self.run_up.u[np.clip(index, 0, len(self.run_up.u) - 1)]
        return np.where(on[..., None], before, out)

"""Results of `planner.certify`: what is proven of a plan, one claim per requirement."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import Any, Literal, TypeVar

import numpy as np

from planner.errors import Violation
from planner.support.arrays import Array, Frozen
from planner.support.tables import Column, html_table

Status = Literal["proven", "undecided", "violated"]


@dataclass(frozen=True)
class Claim:
    """Result of the proof of one requirement, over all time.

    Attributes:
        label: The requirement, as in `verify` ("input u2", "joint theta3").
        status: "proven", "violated" (also by proof), or "undecided".
        guaranteed: Proven lower bound of the margin; −inf if there is none.
        attained: Proven upper bound of the least margin, reached at `time_s`; NaN if unknown.
        time_s: Time of the least margin, in seconds; None if unknown, or if no single time has it.
        unit: Unit of the margin.
        required: Whether the problem requires this; otherwise the claim is informative.
        why: Reason why the claim is undecided; empty otherwise.
    """

    label: str
    status: Status
    guaranteed: float
    attained: float
    time_s: float | None
    unit: str
    required: bool = True
    why: str = ""

    def __repr__(self) -> str:
        return f"Claim({self})"

    def __str__(self) -> str:
        when = "" if self.time_s is None else f" at t = {self.time_s:.6g} s"
        unit = f" {self.unit}" if self.unit else ""
        if self.status == "proven" and self.guaranteed < 0:
            more = f"exceeded by {-self.guaranteed:.4g}{unit} at most"
            return f"{self.label}: proven within the tolerance, {more}"
        if self.status == "proven":
            return f"{self.label}: proven, margin {self.guaranteed:.4g}{unit} or more"
        if self.status == "violated" and not self.required:
            return f"{self.label}: left{when}, which the problem allows"
        if self.status == "violated":
            return f"{self.label}: violated by {-self.attained:.4g}{unit}{when}"
        return f"{self.label}: not proven{when}: {self.why}"


COLUMNS: list[Column[Claim]] = [
    Column("requirement", "", lambda c: c.label, left=True),
    Column("status", "", lambda c: c.status + " (not required)" * (not c.required), left=True),
    Column("margin", "", lambda c: f"{c.guaranteed:.4g} {c.unit}".strip()),
    Column("least at", "s", lambda c: "" if c.time_s is None else f"{c.time_s:.4g}"),
]
"""Columns of the table of claims in a notebook."""


@dataclass(frozen=True)
class Certificate(Frozen):
    """What is proven of a plan's true motion, on whole intervals and not only at samples.

    Attributes:
        claims: One claim per requirement.
        motion_error: Proven bound of |plan.q(t) − true motion| over all time, by coordinate name,
            in the coordinates' units; infinite if no bound is proven.
        cells: Number of subintervals used in the proof.
        seconds: Computing time, in seconds.
        edges: Increasing times, seconds, that divide the motion into the subintervals of the
            proofs; they are closest where the motion's expressions change fast. Empty if the motion
            is not enclosed, or the certificate was read from a file.
    """

    claims: tuple[Claim, ...]
    motion_error: Mapping[str, float]
    cells: int
    seconds: float
    edges: Array = field(default_factory=lambda: np.empty(0), compare=False, repr=False)

    @property
    def ok(self) -> bool:
        """Whether every requirement of the problem is proven."""
        required = [c for c in self.claims if c.required]
        return bool(required) and all(c.status == "proven" for c in required)

    @property
    def open(self) -> tuple[Claim, ...]:
        """Claims of required conditions that are not proven, violations first."""
        left = [c for c in self.claims if c.required and c.status != "proven"]
        return tuple(sorted(left, key=lambda c: c.status != "violated"))

    @property
    def sampled_labels(self) -> tuple[str, ...]:
        """Labels of requirements that are undecided: `verify` samples them, nothing proves them."""
        return tuple(c.label for c in self.open if c.status == "undecided")

    def turned(self, seconds: float) -> Certificate:
        """Return the certificate of the same motion of this duration, run backwards."""
        claims = turned(self.claims, seconds)
        return replace(self, claims=claims, edges=seconds - self.edges[::-1])

    def __getitem__(self, label: str) -> Claim:
        for claim in self.claims:
            if claim.label == label:
                return claim
        raise KeyError(f"no claim '{label}'; there are: {', '.join(c.label for c in self.claims)}")

    def __repr__(self) -> str:
        return f"Certificate({self})"

    def _repr_html_(self) -> str:
        """Return the table that a notebook shows, one row per claim."""
        return html_table(COLUMNS, self.claims, str(self))

    def __str__(self) -> str:
        required = [c for c in self.claims if c.required]
        if self.ok:
            off = f"true motion within {max(self.motion_error.values()):.1e} rad or m of the plan's"
            return f"all {len(required)} requirements proven between the nodes; {off}"
        counted = f"{len(required) - len(self.open)} of {len(required)} requirements proven"
        more = f" (and {len(self.open) - 1} more)" if len(self.open) > 1 else ""
        if not self.open or self.open[0].status == "violated":
            return f"{counted}; {self.open[0]}{more}" if self.open else "no requirement to prove"
        sampled = f"the others were only sampled: {shown_labels(self.sampled_labels)}"
        return f"{counted}; {sampled} ({self.open[0].why})"

    def to_dict(self) -> dict[str, Any]:
        """Return JSON-ready data that `certificate_from_dict` reads; unknown numbers are null."""
        return {
            "ok": self.ok,
            "text": str(self),
            "claims": [
                {
                    **asdict(c),
                    "guaranteed": _finite(c.guaranteed),
                    "attained": _finite(c.attained),
                    "text": str(c),
                }
                for c in self.claims
            ],
            "only_sampled": list(self.sampled_labels),
            "motion_error": {name: _finite(e) for name, e in self.motion_error.items()},
            "cells": self.cells,
            "seconds": self.seconds,
        }


Timed = TypeVar("Timed", Claim, Violation)


def turned(each: Sequence[Timed], seconds: float) -> tuple[Timed, ...]:
    """Return claims or violations of the same motion of this duration, run backwards."""
    times = (None if one.time_s is None else seconds - one.time_s for one in each)
    return tuple(replace(one, time_s=time_s) for one, time_s in zip(each, times, strict=True))


MOST_LABELS = 3
"""Largest number of labels in one line; further labels are only counted."""


def shown_labels(labels: Sequence[str]) -> str:
    """Return up to `MOST_LABELS` labels as one text that ends with the number of the others."""
    more = len(labels) - MOST_LABELS
    return ", ".join(labels[:MOST_LABELS]) + (f" and {more} more" if more > 0 else "")


def certificate_from_dict(data: Mapping[str, Any]) -> Certificate:
    """Return the certificate that `Certificate.to_dict` wrote."""
    errors = {n: np.inf if e is None else e for n, e in data["motion_error"].items()}
    claims = tuple(_claim_from_dict(c) for c in data["claims"])
    return Certificate(claims, errors, data["cells"], data["seconds"])


def _claim_from_dict(data: Mapping[str, Any]) -> Claim:
    unknown = {"guaranteed": -np.inf, "attained": np.nan}
    filled: dict[str, Any] = {k: unknown.get(k) if v is None else v for k, v in data.items()}
    filled.pop("text", None)
    return Claim(**filled)


def _finite(value: float) -> float | None:
    return value if np.isfinite(value) else None


def undecided_claim(label: str, unit: str, why: str, required: bool = True) -> Claim:
    """Return an undecided claim without bound and time, for the reason `why`."""
    return Claim(label, "undecided", -np.inf, np.nan, None, unit, required, why)

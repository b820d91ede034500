"""The paper's figures and numbers, regenerated from nothing."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from planner.files import folder
from planner.reproduce.cases import Cases, cases, paper_problem
from planner.reproduce.figures import figures
from planner.reproduce.numbers import Finding, findings
from planner.reproduce.page import page

__all__ = ["Finding", "Reproduction", "paper_problem", "reproduce"]

Progress = Callable[[str, float], None]


@dataclass(frozen=True)
class Reproduction:
    """What `reproduce` made.

    Attributes:
        path: The folder: README.md, one PNG a figure.
        findings: The paper's numbers and claims, each with a verdict.
        cases: The plans behind the figures.
    """

    path: Path
    findings: tuple[Finding, ...]
    cases: Cases


def reproduce(
    path: str | Path, samples: int = 200, seed: int = 0, progress: Progress | None = None
) -> Reproduction:
    """Regenerate the paper's figures and check its numbers.

    Args:
        path: Folder to write, whole or not at all.
        samples: Machines that Figs 9 and 10 are replayed on.
        seed: Seed of the machines.
        progress: Called with what is being done and the share done, 0 … 1.

    Raises:
        InputError: If the folder cannot be written.
    """
    say = progress or (lambda what, share: None)
    with folder(path) as place:
        say("planning and replaying", 0.0)
        made = cases(samples, seed)
        say("checking printed numbers", 0.4)
        found = findings(made)
        drawn = figures(made)
        for k, (name, figure) in enumerate(drawn.items()):
            say(f"drawing {name}", 0.6 + 0.4 * k / len(drawn))
            figure.savefig(place / f"{name}.png", dpi=110, bbox_inches="tight")
        (place / "README.md").write_text(page(found, samples, seed), encoding="utf-8")
    return Reproduction(Path(path), tuple(found), made)

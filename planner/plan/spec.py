"""A method with options as text: `polynomial:travel=middle`, `sinusoid compensated + feedback`.

Users write such texts, and tables and figures use them as labels of plans.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from planner.plan.plan import COMPENSATED
from planner.support.arrays import Frozen
from planner.support.tables import line

FEEDBACK = " + feedback"
"""The end of the label of a plan that is followed with feedback."""


@dataclass(frozen=True)
class Spec(Frozen):
    """A method, changes of its options, and what becomes of its plan.

    Attributes:
        method: Name of the method; of a user's own label, the whole label.
        settings: The options as text, each `key=value`.
        compensated: Whether the method's plan is compensated for the machine.
        feedback: Whether feedback follows the plan.
        options: The values in `settings`, which override the problem's table of the method; empty
            for a label.
    """

    method: str
    settings: tuple[str, ...] = ()
    compensated: bool = False
    feedback: bool = False
    options: Mapping[str, Any] = field(default_factory=dict, compare=False)

    @classmethod
    def of_label(cls, label: str) -> Spec:
        """Read a label as its spec; any label of the user's own becomes the method's name."""
        text = label.removesuffix(FEEDBACK)
        name, *settings = (line(part) for part in split(text, ":"))
        first, _, word = name.partition(" ")
        if word not in ("", COMPENSATED):
            first, word, settings = text, "", []
        return cls(first, tuple(settings), word == COMPENSATED, label != text)

    @property
    def text(self) -> str:
        """The spec as commands take it, without feedback."""
        name = f"{self.method} {COMPENSATED}" if self.compensated else self.method
        return ":".join([name, *self.settings])

    @property
    def label(self) -> str:
        """The spec in tables and figures."""
        return self.text + FEEDBACK * self.feedback

    @property
    def plain(self) -> Spec:
        """The spec of the same plan without compensation and feedback."""
        return replace(self, compensated=False, feedback=False)


def split(text: str, separator: str) -> Iterator[str]:
    """Yield the parts of a text between separators that lie outside brackets and quotes."""
    depth, quote, start = 0, "", 0
    for k, character in enumerate(text):
        if quote:
            quote = "" if character == quote else quote
        elif character in "'\"":
            quote = character
        elif character in "[{(":
            depth += 1
        elif character in ")}]":
            depth -= 1
        elif character == separator and depth == 0:
            yield text[start:k]
            start = k + 1
    yield text[start:]

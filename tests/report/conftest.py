"""What all tests of reports share."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache

import pytest

from planner.report.page import page


@pytest.fixture(scope="session", autouse=True)
def _mechanisms_are_drawn_once() -> Iterator[None]:
    """Pages of the same arm show the same drawing, which takes most of a second."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(page, "mechanism_svg", cache(page.mechanism_svg))
        yield

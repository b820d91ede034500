"""Figures show themselves in notebooks."""

from __future__ import annotations

from compared import outside

from planner.report.figures.over_time import plot_z


def test_a_figure_is_a_picture_for_a_notebook() -> None:
    figure, _ = plot_z(outside())
    assert figure._repr_png_().startswith(b"\x89PNG")

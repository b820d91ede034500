"""A figure that notebooks display by itself; a separate file, since matplotlib imports slowly."""

from __future__ import annotations

from io import BytesIO

from matplotlib.figure import Figure


class NotebookFigure(Figure):
    """A figure that is displayed as a picture if it is the last expression of a notebook cell."""

    def _repr_png_(self) -> bytes:
        """Return the PNG that IPython displays."""
        content = BytesIO()
        self.savefig(content, format="png", bbox_inches="tight")
        return content.getvalue()

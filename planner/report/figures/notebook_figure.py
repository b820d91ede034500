"""The figure that a notebook shows by itself; apart, since matplotlib is slow to import."""

from __future__ import annotations

from io import BytesIO

from matplotlib.figure import Figure


class NotebookFigure(Figure):
    """A figure that is drawn as a picture where it is the last expression of a notebook's cell."""

    def _repr_png_(self) -> bytes:
        """What IPython asks a value for."""
        content = BytesIO()
        self.savefig(content, format="png", bbox_inches="tight")
        return content.getvalue()

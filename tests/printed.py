"""What a terminal shows."""

from __future__ import annotations

import io

from rich.console import Console
from rich.table import Table


def printed(table: Table | None, width: int = 200) -> list[str]:
    """The lines of a table, without the spaces at their ends."""
    console = Console(width=width, file=io.StringIO(), record=True)
    console.print(table)
    return [line.rstrip() for line in console.export_text().splitlines()]

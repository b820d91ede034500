"""The `[machine]` table: the emulated machine's preset and what to change in it."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from planner.schema.base import Table


class MachineTable(Table):
    """Overrides of a machine preset."""

    preset: Literal["prototype", "ideal"] = Field("prototype", description="What to start from.")

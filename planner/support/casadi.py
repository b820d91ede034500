"""CasADi, imported on first use, because `planner new` writes a problem file without it.

`ca` stands for CasADi. The files that `planner new` imports take `ca` from here.
"""

from typing import TYPE_CHECKING

import lazy_loader

if TYPE_CHECKING:
    import casadi as ca
else:
    ca = lazy_loader.load("casadi")

__all__ = ["ca"]

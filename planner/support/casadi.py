"""CasADi, loaded when something of it is first used: a problem file is written without it.

`ca` stands for the module. The files that `planner new` reads import it from here.
"""

from typing import TYPE_CHECKING

import lazy_loader

if TYPE_CHECKING:
    import casadi as ca
else:
    ca = lazy_loader.load("casadi")

__all__ = ["ca"]

"""Motion planning for nonholonomic manipulators: n joints, two motors, friction disks.

>>> import planner
>>> problem = planner.load_problem("problems/paper.toml")
>>> plan = planner.solve(problem, "collocation")
>>> planner.verify(plan).ok
True
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
__all__ = [name for name in __all__ if name not in ("__version__", "report")]

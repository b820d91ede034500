"""Figures, films and pages of plans and comparisons.

`figures` (one `plot_*` function each), `film`, `charts` (drawn by a browser), `page` (a comparison
as a web page), `panels` (the data that all of these draw), `folders` (write everything to a folder)
and `saved` (read it back), `export` (a plan for other programs, `urdf` the arm for ROS,
`controller` the tracker in C).

Every `plot_*` function takes plans (or replays), draws into your axes or a new figure, and returns
both: `figure, axes = plot_z({"one": plan, "other": plan2})`. `plot_mechanism` takes an arm,
`plot_design` a study of designs.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)

"""Figures, films and pages of plans and comparisons.

`figures` (one `plot_*` each), `film`, `charts` (in a browser), `page` (a comparison there),
`panels` (what of plans is drawn, for all of these),
`folders` (all of it in a folder) and `saved` (read back), `export` (a plan for other programs,
`urdf` the arm for ROS, `controller` the tracker in C).

Every `plot_*` function takes plans (or replays), draws into axes of yours or a new figure, and
returns both: `figure, axes = plot_z({"one": plan, "other": plan2})`. `plot_mechanism` takes an arm,
`plot_design` a study of designs.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)

"""Figures, films and pages of plans and comparisons.

`figures` has the `plot_*` functions, one per figure; `film` animates the motion. `page` writes a
comparison as a web page, on which `charts` draws in the browser. `panels` computes the data of all
figures of plans. `folders` writes results with their figures to folders (`result_folder`), and
`saved` reads a comparison back. `properties` is the table of a plan, `analysis` that of what
`check` finds. `export` writes a plan for
other programs, including the arm as URDF for ROS (`urdf`) and the tracker, the feedback controller
that follows the plan, in C (`controller`).

Every `plot_*` function takes plans (or replays), draws into the given axes or a new figure, and
returns the figure and its axes: `figure, axes = plot_z({"one": plan, "other": plan2})`.
`plot_mechanism` takes an arm, `plot_design` a study of designs.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)

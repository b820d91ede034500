"""Pictures of plans and of the mechanism; every `plot_*` draws into your axes or a new figure.

Read in this order: `style` and `notebook_figure` (common to all), `over_time` (inputs, joints, z),
`arm` (motion in the plane), `mechanism` (motors, disks, gears and belts), `on_the_machine` (replays
and errors), `recorded` (runs of a real arm), `robustness` (sensitivities, error budgets,
trade-off), `design` (studies of mechanisms), `sweep` (many cases).
"""

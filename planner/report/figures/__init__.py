"""Pictures of plans and of the mechanism; every `plot_*` draws into your axes or a new figure.

In this order: `style`, `notebook_figure` (displays itself); `over_time` (inputs, joints, z), `arm`
(in the plane), `mechanism` (motors, disks, gears and belts), `on_the_machine` (replays, errors),
`recorded` (runs of an arm), `robustness` (sensitivities, budgets, trade-off), `design` (studies of
mechanisms), `sweep` (many cases).
"""

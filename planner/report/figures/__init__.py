"""Pictures of plans and comparisons; every `plot_*` draws into axes of yours or a new figure."""

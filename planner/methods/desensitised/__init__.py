"""Plans with a small response to errors of inputs, start and constants (`method`)."""

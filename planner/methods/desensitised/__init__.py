"""Plans that answer little to errors of inputs, start and constants (`method`)."""

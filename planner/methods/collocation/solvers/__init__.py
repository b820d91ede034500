"""Who solves the programme, and with what patience: `backends`, then `solver`."""

"""The tracker: `tracker` first, then `course`, `reference`, `run_up`, `estimate`, `programme`."""

"""Many methods on the same machines: `compare`, `rows`, `comparison`, `differences`."""

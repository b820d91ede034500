"""Friction contacts: `contacts` has the law, `contact_load` the largest loads along a plan."""

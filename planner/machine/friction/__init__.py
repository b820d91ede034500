"""Friction contacts: `contacts` has the law, `contact_load` what a plan asks of them."""

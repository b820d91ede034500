"""What is asked: a problem, its file, its requirements, and what no plan can beat.

In this order: `requirements`, `tables`, `problem`, `feasibility`, `nonholonomy`.
"""

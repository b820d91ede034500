"""Recorded runs of an arm, from files of other programs.

In this order: `number_table` (reads any table of numbers), `columns` (finds a log's columns and
their units), `bag` (reads the same table from a ROS 2 bag), `log` (a recorded run, and checks on
it).
"""

"""What an arm did, from the files of other programs.

In this order: `number_table` (a table of numbers, whoever wrote it), `columns` (what they are
called in a log, and their units), `bag` (the same table from a ROS 2 bag), `log` (a recorded run,
and what is refused as one).
"""

"""What an arm did, from the files of other programs.

In this order: `number_table` (a table of numbers, whoever wrote it), `columns` (what they are
called in a log, and their units), `log` (a recorded run, and what is refused as one).
"""

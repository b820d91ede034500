"""A comparison as a web page that opens from disk.

`page` assembles it, `series` holds the data for its scripts, `words` writes its text.
"""

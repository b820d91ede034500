"""The page that opens from disk.

`page` puts it together, `series` is what its scripts draw, `words` what it says.
"""

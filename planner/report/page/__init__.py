"""The page that opens from disk: `page`, `series`, `words`."""

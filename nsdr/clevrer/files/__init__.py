"""CLEVRER's files: one reader for each kind, a writer where one is needed, and the scenes that they describe."""

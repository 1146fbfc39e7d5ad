"""Programs for people and agents around a pipeline: the page to ask on, and tools for agents."""

"""The nine systems of the paper's Table 2 that are trained, and what they share."""

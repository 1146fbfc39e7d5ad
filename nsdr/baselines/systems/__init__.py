"""The nine trained systems of the paper's Table 2, and the layers that they share."""

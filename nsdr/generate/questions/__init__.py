"""Generation of balanced questions about scenes with known ground truth."""

"""Detection of collisions in observed motion by a temporal network on whole tracks."""

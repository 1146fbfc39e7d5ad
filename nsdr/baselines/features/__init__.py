"""Features of videos: the network that makes them, their extraction, and the files that hold them."""

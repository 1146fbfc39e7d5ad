"""Training of the neural parts: one resumable loop, and for each part a task and a `main(argv)` that runs it."""

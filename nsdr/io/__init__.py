"""Files, storage, checkpoints, configuration, fingerprints, devices and the runner of long work; knows no CLEVRER file."""

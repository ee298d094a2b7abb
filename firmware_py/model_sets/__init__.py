"""Sets of models on disk: what is in one, whose it is, and which one the device uses."""

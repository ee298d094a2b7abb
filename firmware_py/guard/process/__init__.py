"""What surrounds the pure core in its process: time grid, budget, files, events until stored."""

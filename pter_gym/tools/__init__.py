"""Tools built on the simulator, one per folder: each imports the core only."""

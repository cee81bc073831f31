"""Tools built on the simulator, one per folder, which imports the core only."""

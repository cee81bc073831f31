"""Tools built on the simulator: each folder is one, imports the core and no other tool, and may be deleted."""

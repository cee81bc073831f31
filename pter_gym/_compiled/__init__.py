"""The compiler, its cache, records in flat arrays, and random numbers."""

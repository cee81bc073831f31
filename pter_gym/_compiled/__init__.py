"""What compiled code is made of: the compiler, records in flat arrays, counter-based random numbers."""

"""Hardware in the loop: the simulated arm at one end of a serial line, a controller at the other."""

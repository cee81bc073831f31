"""Hardware in the loop: a controller drives the simulated arm over a serial line."""

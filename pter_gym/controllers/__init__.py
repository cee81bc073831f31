"""Control laws: an observation in, four clutch voltages out."""

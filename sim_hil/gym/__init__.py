"""Environments for learning: the control task on one machine, or on many rotors at once."""

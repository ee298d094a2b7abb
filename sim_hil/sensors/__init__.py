"""From motion to counts: pick-ups, anti-alias filter, calibration errors, noise, quantisation."""

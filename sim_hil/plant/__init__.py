"""The machine in time: one build, its rotor, sensors and drive, along a duty."""

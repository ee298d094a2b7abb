"""The parts of the `orbitd` command line that belong to the device itself."""

"""orbitd: one edge device that simulates, diagnoses, predicts and controls a rotor on a fluid
film."""

__version__ = "0.1.0"

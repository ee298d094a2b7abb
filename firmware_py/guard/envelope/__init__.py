"""What may be asked of the actuator: load and oil as intervals, and the clearances they admit."""

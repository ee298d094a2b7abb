"""The whole rig behind the bus: samples, actuator node and drive on their wires."""

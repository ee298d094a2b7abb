"""What crosses the wires: CAN FD frames and MAVLink packets, and the links that carry them."""

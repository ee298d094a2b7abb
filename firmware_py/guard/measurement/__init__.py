"""What one turn of the shaft says: exact integer statistics of raw counts, and orders of the
orbit."""

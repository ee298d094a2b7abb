"""Which inputs may be believed: readings, probe pair, marks, standstill, lost frames."""

"""Alert, danger and trip of vibration, oil and speed, and the run permit (terms of API 670)."""

"""Protection, shield, arming and the real-time loop (ISO 13374 SD, and actuation)."""

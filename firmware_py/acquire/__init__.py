"""Frames off the link to time-stamped blocks, windows and features (ISO 13374 DA, DM)."""

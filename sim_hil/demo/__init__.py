"""The demo: the whole device against the rig in software, told as a story and scored from the rig's
truth."""

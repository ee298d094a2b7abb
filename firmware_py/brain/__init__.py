"""The brain: diagnoses, predicts and proposes; it has no access to the bus (ISO 13374 HA, PA,
AG)."""

"""The gate: Zenoh, flight recorder, metrics, live page and command intake; never the bus."""

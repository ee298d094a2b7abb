"""Replay: a recording through the same stages again, every decision and every diagnosis
compared."""

from firmware_py.replay.command import main

__all__ = ["main"]

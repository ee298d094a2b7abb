"""Types of command line options that several commands share; each refuses with one line."""

from __future__ import annotations

import argparse
import math


def finite(text: str) -> float:
    """A finite number."""
    try:
        value = float(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r} is no number") from None
    if not math.isfinite(value):
        raise argparse.ArgumentTypeError(f"{text} is not finite; give a number")
    return value


def seed(text: str) -> int:
    """A whole number from 0 to 2^63 - 1, from which random numbers follow."""
    return _whole(text, 0, 2**63 - 1)


def count(text: str) -> int:
    """How many: a whole number from 1 to 10^9."""
    return _whole(text, 1, 10**9)


def port(text: str) -> int:
    """A network port; 0 for none."""
    return _whole(text, 0, 65_535)


WINDOW_S = (0.02, 60.0)
"""Least and greatest length of a window of samples, s."""


def window_seconds(text: str) -> float:
    """Length of a window of samples, s."""
    value, (low, high) = finite(text), WINDOW_S
    if not low <= value <= high:
        raise argparse.ArgumentTypeError(f"{text}: outside {low:g} .. {high:g} s")
    return value


def _whole(text: str, low: int, high: int) -> int:
    try:
        value = int(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r} is no whole number") from None
    if not low <= value <= high:
        raise argparse.ArgumentTypeError(f"{text}: outside {low} .. {high}")
    return value

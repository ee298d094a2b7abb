"""How much speaks for a condition: what speaks against it takes away a little less than it brought.

A count that begins anew with each good report never ends where good and bad ones alternate.  This
one adds up as soon as bad ones make up more than four ninths, whatever their order.
"""

from __future__ import annotations

from typing import Final

import msgspec

BAD: Final = 5
GOOD: Final = 4
"""What a bad report, or a nanosecond of bad time, adds, and what a good one takes away: a condition
that is there half of the time adds up."""


def counted(level: int, bad: bool, amount: int, enough: int) -> int:
    """The level after so much more that is bad, or is good; never above what is asked of it."""
    level, most = level + (BAD if bad else -GOOD) * amount, BAD * enough
    level = 0 if level < 0 else level
    return most if most < level else level


class Tally(msgspec.Struct, array_like=True):
    """A leaky count, in reports or in ns."""

    level: int = 0

    def add(self, bad: bool, amount: int, enough: int) -> bool:
        """So much more is bad, or is good; True once ``enough`` bad has come together."""
        self.level = counted(self.level, bad, amount, enough)
        return bad and self.level >= BAD * enough

    @property
    def amount(self) -> int:
        """How much bad is left."""
        return self.level // BAD

    def clear(self) -> None:
        """Nothing is left of what was."""
        self.level = 0

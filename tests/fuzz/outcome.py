"""What came of some cases of a fuzz target."""

from __future__ import annotations

from dataclasses import dataclass, field


@dataclass
class Outcome:
    """How many cases were tried, how many of them were called good, and a line for each failure."""

    tried: int = 0
    good: int = 0
    failures: list[str] = field(default_factory=list)

    def add(self, name: str, good: bool, wrong: list[str]) -> None:
        """One more case."""
        self.tried += 1
        self.good += good
        self.failures += [f"{name}: {each}" for each in wrong]

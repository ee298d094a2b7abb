"""The short form of the fuzz target for damaged recordings."""

from __future__ import annotations

from tests.fuzz import damaged_recordings


def test_random_damage_is_survived_and_nothing_false_is_believed() -> None:
    assert damaged_recordings.run(seed=1, n=150) == []

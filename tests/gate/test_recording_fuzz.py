"""The short form of the fuzz target for damaged recordings."""

from __future__ import annotations

from pathlib import Path

from tests.fuzz import damaged_recordings


def test_random_damage_is_survived_and_nothing_false_is_believed(tmp_path: Path) -> None:
    outcome = damaged_recordings.run(1, 150, tmp_path)
    assert outcome.failures == []
    assert outcome.tried == 150
    assert outcome.good > 100

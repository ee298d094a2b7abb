"""The guard's reaction as the demo measures it: real processes on a bus of their own."""

from __future__ import annotations

import pytest

from sim_hil.demo import latency
from sim_hil.demo.setting import prepare


@pytest.mark.timing
def test_the_reaction_to_danger_is_measured() -> None:
    """The generator's shaft is one that the guard believes: it arms, goes wide and comes back."""
    found = latency.measure(prepare("bench", 3), 3)
    reaction = found["exceedance_to_safe"]
    assert "failed" not in reaction, reaction
    assert reaction["trials"] == 3
    assert 0.0 < reaction["p50"] < 50.0
    assert found["echo"]["answered"] == found["echo"]["sent"]

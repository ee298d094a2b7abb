"""The guard's reaction as the demo measures it: real processes on a bus of their own."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import pytest

from sim_hil.demo import latency
from sim_hil.demo.report import TERMS
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


@pytest.mark.parametrize(
    ("reaction", "holds"), [(None, True), ({"p50": 5.0}, True), ({"failed": "no answer"}, False)]
)
def test_a_measurement_that_failed_is_no_success(
    reaction: dict[str, Any] | None, holds: bool
) -> None:
    found = {"exceedance_to_safe": reaction, "echo": None, "shipped_danger_delay_ms": 3000.0}
    outcome = cast(Any, SimpleNamespace(latency=found))
    assert TERMS["latencies measured"](outcome) is holds

"""No reader, however fast, stands before a local ``disarm``."""

from __future__ import annotations

import pytest

from tests.gate.flood import device, measure

pytestmark = pytest.mark.timing

BAR_S = 0.2
"""For the median."""

WORST_S = 1.0
TRIES = 3
"""A test machine has other work on it; `python -m tests.gate.flood` on an idle one shows the worst
below the bar."""


@pytest.fixture(scope="module")
def running(tmp_path_factory):
    folder = tmp_path_factory.mktemp("flood")
    with device(folder) as ports:
        yield folder, ports


@pytest.mark.parametrize(
    "name", ["event", "cmd/arm", "cmd/disarm", "everything", "page", "mavlink"]
)
def test_a_disarm_is_answered_while_another_client_asks_at_its_greatest_rate(running, name):
    folder, ports = running
    found = []
    for _ in range(TRIES):
        took = sorted(measure(name, folder, ports, 9))
        found.append(f"{took[4]:.3f} s (worst {took[-1]:.3f})")
        if took[4] <= BAR_S and took[-1] <= WORST_S:
            return
    pytest.fail(f"disarm took {', '.join(found)} beside {name}")

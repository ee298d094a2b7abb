"""No reader, however fast, stands before a local ``disarm``."""

from __future__ import annotations

import pytest

from tests.gate.flood import device, measure

BAR_S = 0.2
TRIES = 3
"""The bar is for a machine of one's own; a test machine has others on it."""


@pytest.fixture(scope="module")
def running(tmp_path_factory):
    folder = tmp_path_factory.mktemp("flood")
    with device(folder) as ports:
        yield folder, ports


@pytest.mark.parametrize("name", ["event", "cmd/arm", "cmd/disarm", "everything", "page", "mavlink"])
def test_a_disarm_is_answered_while_another_client_asks_at_its_greatest_rate(running, name):
    folder, ports = running
    worst = []
    for _ in range(TRIES):
        worst.append(max(measure(name, folder, ports, 8)))
        if worst[-1] <= BAR_S:
            return
    pytest.fail(f"disarm took {', '.join(f'{each:.3f}' for each in worst)} s beside {name}")

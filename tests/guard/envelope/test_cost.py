"""The error budget is that of the guard: what it admits with an uncertainty and without."""

from __future__ import annotations

import msgspec
import pytest

from firmware_py import config
from firmware_py.guard.envelope.cost import CERTAIN, LOAD, Cost, costs, without
from firmware_py.guard.envelope.shield import Shield

BENCH = config.load(config.SHIPPED / "bench")[0]
KNOWN_BADLY = BENCH.replaced(
    bearing=msgspec.structs.replace(
        BENCH.machine.bearing, radial_clearance_error_um=5.0, load_error_share=0.21,
        attitude_error_deg=15.0,
    )
)  # fmt: skip


@pytest.fixture(scope="module")
def found() -> dict[str, Cost]:
    return {cost.name: cost for cost in costs(KNOWN_BADLY, 42.0)}


def test_every_uncertainty_has_a_row_and_the_first_is_the_machine_itself(
    found: dict[str, Cost],
) -> None:
    assert list(found) == ["", *CERTAIN, LOAD]
    low_m, high_m = Shield(KNOWN_BADLY).fixed_range() or (0.0, 0.0)
    assert found[""].range_m == high_m - low_m
    assert len(found[""].corners) == 4


def test_to_know_more_never_costs(found: dict[str, Cost]) -> None:
    for name, cost in found.items():
        assert cost.range_m >= found[""].range_m, name
        for before, after in zip(found[""].corners, cost.corners, strict=True):
            assert before is not None
            assert after is not None
            assert after.high_m >= before.high_m - 0.1e-6, name
            assert after.power_W <= before.power_W + 0.5, name


def test_a_micrometre_of_the_clearance_costs_a_micrometre_of_the_retreat_range(
    found: dict[str, Cost],
) -> None:
    gained_um = (found["clearance"].range_m - found[""].range_m) * 1e6
    assert gained_um == pytest.approx(5.0, abs=1.01)  # whirl bounds the range; the grid is 1 um


def test_load_film_and_probes_count_where_the_load_is_estimated(found: dict[str, Cost]) -> None:
    gained = {
        name: cost.corners[3].power_W - before.power_W  # 12000 rpm, 300 N
        for name, cost in found.items()
        if cost.corners[3] and (before := found[""].corners[3])
    }
    for name in ("clearance", "oil", "probes", "film law", LOAD):
        assert gained[name] < -1.0, gained
    assert gained["torque meter"] == pytest.approx(0.0, abs=0.1)


def test_where_nothing_is_admissible_there_is_no_cost() -> None:
    heavy = msgspec.structs.replace(BENCH.machine.operating, load_max_N=12_000.0)
    found = costs(BENCH.replaced(operating=heavy), 42.0)[0]
    assert found.range_m == 0.0
    assert found.corners[1] is None  # more than the film carries at rest
    heavy = msgspec.structs.replace(BENCH.machine.operating, load_max_N=900.0)
    assert costs(BENCH.replaced(operating=heavy), 42.0)[0].corners[1] is None  # not the film limit


def test_without_changes_only_what_it_names() -> None:
    certain = without(BENCH, "probes")
    assert certain.machine.channel[0].gain_error_share == 0.0
    assert certain.machine.channel[2:] == BENCH.machine.channel[2:]
    assert certain.machine.bearing == BENCH.machine.bearing

"""The retreat after the loss of the oil pump, on the rig with the supply of its folder."""

from __future__ import annotations

import pytest

from tests.guard.protection.pump_loss import play


@pytest.mark.slow
def test_with_the_declared_accumulator_the_retreat_ends_before_the_film_starves() -> None:
    loss = play(2)
    assert loss.wide_um > 70.0
    assert (
        loss.safe_s - loss.alert_s < 2.45
    )  # what `check` reckons with from the farthest clearance
    assert loss.margin_s > 0.0
    assert loss.trip_s > loss.not_full_s
    assert loss.least_film_um > 10.0


@pytest.mark.slow
def test_without_one_it_does_not() -> None:
    assert play(2, hold_up=False).margin_s < 0.0

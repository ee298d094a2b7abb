"""One viscosity law, with the same bits on every machine."""

from __future__ import annotations

from math import exp

import pytest

from firmware_py.config import SHIPPED, load
from firmware_py.machine.lubricant import CredibleOil, ViscosityTable, decay, viscosity_Pa_s

BENCH = load(SHIPPED / "bench")[0].machine
OIL = BENCH.lubricant


def exact(temperature_C: float) -> float:
    """The law as a textbook writes it."""
    return OIL.viscosity_at_40C_Pa_s * exp(-OIL.viscosity_slope_per_K * (temperature_C - 40.0))


@pytest.mark.parametrize("exponent", [0.0, 0.01, 0.03, 0.1, 0.5, 1.0])
def test_decay_is_the_exponential(exponent: float) -> None:
    assert decay(exponent) == pytest.approx(exp(-exponent), rel=1e-14)


@pytest.mark.parametrize("temperature", [-40.0, -10.0, 19.5, 40.0, 41.01, 41.5, 60.0, 119.9, 199.9])
def test_the_table_is_the_law(temperature: float) -> None:
    assert viscosity_Pa_s(OIL, temperature) == pytest.approx(exact(temperature), rel=1.2e-4)
    assert viscosity_Pa_s(OIL, temperature) == ViscosityTable(OIL).law(temperature)


def test_the_credible_oils_are_every_batch_at_every_temperature_of_the_reading() -> None:
    table, law = CredibleOil(BENCH), exact(41.0)
    ends = [exact(41.0 + error) * batch / law for error in (-1, 1) for batch in (0.9, 1.1)]
    assert (table.thinnest, table.thickest) == pytest.approx((min(ends), max(ends)))

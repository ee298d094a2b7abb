"""Errors of probes and readings stand in the machine, and every stage takes them from there."""

from __future__ import annotations

import msgspec
import pytest

from firmware_py.brain.measurement import Errors
from firmware_py.brain.unbalance import ImbalanceFilter
from firmware_py.config import SHIPPED, Config, load
from firmware_py.guard.envelope.load_estimate import LoadEstimator
from firmware_py.guard.plausibility.pair_verdicts import PairVerdicts
from firmware_py.guard.plausibility.pair_window import PairSums
from firmware_py.guard.plausibility.readings import Readings
from firmware_py.machine import FastChannel
from firmware_py.machine.lubricant import CredibleOil, coldest_outlet_C
from firmware_py.machine.probes import after_zeroing, as_built, probe_errors, probe_noise_m

BENCH = load(SHIPPED / "bench")[0]
KEYS = [
    key
    for key in FastChannel.__struct_fields__
    if key.startswith("zeroed_") or key in ("zero_error", "gain_error_share", "runout_m")
]


def probes(**figures: object) -> Config:
    """The bench with other figures of both probes."""
    changed = [msgspec.structs.replace(p, **figures) for p in BENCH.machine.channel[:2]]
    return BENCH.replaced(channel=[*changed, *BENCH.machine.channel[2:]])


def readings(**figures: float) -> Config:
    return BENCH.replaced(readings=msgspec.structs.replace(BENCH.machine.readings, **figures))


@pytest.mark.parametrize("name", ["bench", "seed"])
def test_shipped_rigs_say_what_is_typical_bit_for_bit(name: str) -> None:
    """Guard decisions are recorded with these figures."""
    machine = load(SHIPPED / name)[0].machine
    assert len(KEYS) == 6
    silent = [
        msgspec.structs.replace(p, noise_rms=None, **dict.fromkeys(KEYS))
        for p in machine.channel[:2]
    ]
    unsaid = msgspec.structs.replace(machine, channel=[*silent, *machine.channel[2:]])
    for said in (machine, unsaid):
        assert as_built(said) == (2e-6, 0.03, 6e-6, 4e-6)
        assert after_zeroing(said) == (0.5e-6, 0.01, 0.5e-6, 3e-7)
        assert probe_noise_m(said) == 1e-7
    assert coldest_outlet_C(machine) == machine.lubricant.inlet_min_C - 2.0


def test_the_worse_probe_counts_and_both_must_be_zeroed() -> None:
    first, second, *others = BENCH.machine.channel
    worse = msgspec.structs.replace(second, zero_error=3e-6, zeroed=True)
    machine = msgspec.structs.replace(BENCH.machine, channel=[first, worse, *others])
    assert probe_errors(machine) == as_built(machine)
    assert as_built(machine).zero_m == 3e-6
    assert probe_errors(probes(zeroed=True).machine) == after_zeroing(BENCH.machine)


def test_a_better_probe_is_no_worse_after_the_procedure() -> None:
    silent = probes(zero_error=3e-7, **{key: None for key in KEYS if key.startswith("zeroed_")})
    assert after_zeroing(silent.machine) == (3e-7, 0.01, 0.5e-6, 3e-7)


def test_the_guard_takes_the_errors_of_the_probes() -> None:
    for zeroed, before in ((False, ""), (True, "zeroed_")):
        figures = {f"{before}zero_error": 3e-7, f"{before}gain_error_share": 0.007}
        config = probes(zeroed=zeroed, slow_roll_um=4.0, **figures, **{f"{before}runout_m": 4e-7})
        verdicts = PairVerdicts(config, PairSums(config).to_xy)
        for stage in (LoadEstimator(config), verdicts):
            assert (stage._zero_m, stage._gain) == (3e-7, 0.007)
        assert verdicts._runout_m == (4e-6 + 4e-7 if zeroed else 4e-7)


def test_the_brain_takes_the_errors_of_probes_and_readings() -> None:
    errors = Errors.of(probes(zero_error=4e-6, gain_error_share=0.06))
    usual = Errors.of(BENCH)
    assert errors.zero_um == 2.0 * usual.zero_um
    assert errors.gain == 2.0 * usual.gain
    assert Errors.of(readings(oil_outlet_error_C=2.0)).oil_C == 2.0 * usual.oil_C
    runout = [
        ImbalanceFilter(config.machine).state.covariance[0, 0].real
        for config in (BENCH, probes(runout_m=12e-6), probes(zeroed=True))
    ]
    assert runout == [4e-6**2, 8e-6**2, 3e-7**2]


def test_the_guard_takes_the_errors_of_the_readings() -> None:
    rows = Readings(readings(oil_outlet_scatter_C=4.0, clearance_scatter_um=5.0)).rows
    assert rows["oil_outlet"].noise == 4.0
    clearance = rows["clearance_actual"]
    assert (clearance.low, clearance.high, clearance.noise) == (35.0, 165.0, 5.0)
    config = readings(oil_outlet_error_C=3.0)
    assert coldest_outlet_C(config.machine) == 31.0
    assert CredibleOil(config.machine).thickest > CredibleOil(BENCH.machine).thickest

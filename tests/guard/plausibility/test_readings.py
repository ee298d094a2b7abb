"""Slow readings: what cannot be is not believed, costs authority, widens nothing and trips
nothing."""

import msgspec
import numpy as np
import pytest

from firmware_py.guard.plausibility.reading_rows import CLEARANCE, OIL, POWER, PRESSURE, power_max_W
from firmware_py.guard.plausibility.reading_state import OilEvidence, ReadingsState
from firmware_py.guard.plausibility.readings import FROZEN_NS, Readings
from firmware_py.records import Block, ChannelCause, NodeMode, NodeState, RigStatus, cause_bits

from ..scripted_node import MS, Bench, bench, working

FIELDS = {OIL: "oil_C", CLEARANCE: "clearance_um", POWER: "power_W", PRESSURE: "pressure_bar"}
IMPOSSIBLE = [
    (OIL, -327.68),
    (OIL, 327.67),
    (OIL, 151.0),
    (OIL, -21.0),
    (CLEARANCE, 655.35),
    (CLEARANCE, 0.0),
    (CLEARANCE, 20.0),
    (CLEARANCE, 36.0),
    (CLEARANCE, 164.0),
    (POWER, 21_474_836.0),
    (POWER, -21_474_836.0),
    (POWER, 6000.0),
    (PRESSURE, 65.535),
    (PRESSURE, 6.5),
]


def widest(b: Bench) -> tuple[float, float]:
    state = next(d.state for d in reversed(b.run(0.3)) if d.state)
    return state.clearance_low_um, state.clearance_high_um


def last_state(b: Bench):  # type: ignore[no-untyped-def]
    return next(d.state for d in reversed(b.run(0.2)) if d.state)


@pytest.mark.parametrize(("name", "value"), IMPOSSIBLE)
@pytest.mark.parametrize("amplitude_um", [0.5, 12.0])
def test_an_impossible_reading_ends_authority_widens_nothing_and_trips_nothing(
    name: str, value: float, amplitude_um: float
) -> None:
    b = working()
    b.node.amplitude_um = amplitude_um
    low_um, high_um = widest(b)
    setattr(b.node, FIELDS[name], value)
    b.run(2.0)  # twice the danger delay
    found = last_state(b)
    assert f"{name}_not_ok" in [a.name for a in found.alarms]
    assert not found.authority
    assert not found.trip_request
    assert found.clearance_low_um >= low_um - 1e-9 or found.clearance_low_um == 0.0
    assert found.clearance_high_um <= high_um + 1e-9
    assert b.names().count(f"{name}_not_ok") == 1
    text = next(e.text for e in b.events if e.name == f"{name}_not_ok")
    assert "outside" in text
    assert "check its sensor" in text


@pytest.mark.parametrize(("name", "value"), [(OIL, 327.67), (CLEARANCE, 0.0), (PRESSURE, 65.0)])
def test_arming_is_refused_with_all_reasons(name: str, value: float) -> None:
    b = Bench()
    setattr(b.node, FIELDS[name], value)
    b.node.supply_bar = 0.1
    b.run(1.6)
    b.ask("mode", mode=2)
    accepted, reasons = b.ask("arm")
    assert not accepted
    assert any("not known" in r and name in r for r in reasons)
    assert any("supply pressure" in r and "0.4" in r for r in reasons)


@pytest.mark.parametrize(("name", "there"), [(OIL, 60.0), (CLEARANCE, 90.0)])
def test_a_reading_that_jumps_and_returns_is_doubted_until_it_has_been_plausible_for_long(
    name: str, there: float
) -> None:
    b = working()
    before = getattr(b.node, FIELDS[name])
    setattr(b.node, FIELDS[name], there)
    b.run(0.06)
    setattr(b.node, FIELDS[name], before)
    b.run(9.5)
    assert f"{name}_not_ok" in [a.name for a in last_state(b).alarms]
    assert b.names().count("authority_gained") == 1
    b.run(1.0)
    assert f"{name}_not_ok" not in [a.name for a in last_state(b).alarms]
    assert b.names().count(f"{name}_not_ok_ended") == 1


def test_a_clearance_that_lands_where_the_node_goes_has_arrived() -> None:
    b = working()
    b.node.clearance_um = b.node.target_um
    b.run(0.3)
    assert last_state(b).authority


@pytest.mark.parametrize(("reading_um", "least_um"), [(655.35, 25.0), (0.0, 25.0), (20.0, 25.0)])
def test_a_lost_clearance_neither_lifts_nor_closes_the_cap_of_protection(
    reading_um: float, least_um: float
) -> None:
    b = working()
    b.node.clearance_um = reading_um
    b.node.amplitude_um = 0.48 * least_um
    b.run(3.0)
    assert not last_state(b).trip_request
    b.node.amplitude_um = 0.52 * least_um
    b.run(3.0)
    assert last_state(b).trip_request


def test_old_readings_count_as_lost_and_come_back_at_once() -> None:
    b = working()
    b.tamper = lambda frames: [f for f in frames if f.frame_id != 0x0B0]
    b.run(0.4)
    found = last_state(b)
    assert "readings_stale" in [a.name for a in found.alarms]
    assert not found.authority
    b.tamper = list
    b.run(0.1)
    assert "readings_stale" not in [a.name for a in last_state(b).alarms]


def test_the_pressure_is_held_against_its_channel() -> None:
    b = working()
    b.node.supply_bar = 1.5
    b.run(1.5)
    assert last_state(b).authority
    b.run(1.0)
    found = last_state(b)
    assert "pressure_mismatch" in [a.name for a in found.alarms]
    assert not found.authority
    b.node.supply_bar = None
    b.run(0.2)
    assert "pressure_mismatch" in [a.name for a in last_state(b).alarms]
    b.run(2.5)
    assert "pressure_mismatch" not in [a.name for a in last_state(b).alarms]


# ------------------------------------------------------------------ the stage alone


class Alone:
    """The stage with messages every 50 ms."""

    def __init__(self) -> None:
        self.stage, self.now_ns, self.count = Readings(bench()), 10**10, 0
        self.target_um, self.speed_rad_s = 50.0, 600.0
        self.blocks: list[Block] = []
        self.values = {"shaft_power_W": 50.0, "oil_outlet_C": 41.0, "clearance_actual_um": 50.0,
                       "pressure_actual_bar": 1.0}  # fmt: skip

    def step(self, seconds: float = 0.05, jitter: float = 0.0) -> list[str]:
        told = []
        for _ in range(round(seconds / 0.05)):
            self.now_ns += 50 * MS
            self.count += 1
            tick = self.count * 50_000 % 2**32
            values = {
                name: value + jitter * (self.count & 1) for name, value in self.values.items()
            }
            status = RigStatus(self.count, tick, **values)
            node = NodeState(0, tick, NodeMode.SAFE, 0, 0, self.target_um, 1.0, True, 0, 0, 0, 0)
            notices = self.stage.step(
                self.blocks, status, self.now_ns, node, self.speed_rad_s, self.now_ns
            )
            told += [n.name for n in notices]
        return told

    def frozen(self, **changed: float) -> list[str]:
        self.step(1.0)
        self.values |= {k: v for k, v in changed.items() if k in self.values}
        self.speed_rad_s = changed.get("speed_rad_s", self.speed_rad_s)
        return self.step(FROZEN_NS * 1e-9 + 1.0)


@pytest.mark.parametrize("value", [float("nan"), float("inf"), float("-inf")])
@pytest.mark.parametrize(
    "field", ["shaft_power_W", "oil_outlet_C", "clearance_actual_um", "pressure_actual_bar"]
)
def test_what_is_no_number_is_not_ok(field: str, value: float) -> None:
    alone = Alone()
    alone.step(1.0)
    alone.values[field] = value
    assert [name for name in alone.step() if name.endswith("_not_ok")] == [
        f"{field.rpartition('_')[0]}_not_ok"
    ]
    known = alone.stage.known()
    assert known is None or known.power_W is None


def test_a_reading_that_repeats_itself_while_its_cause_moves_is_frozen() -> None:
    assert Alone().frozen() == []
    assert Alone().frozen(speed_rad_s=650.0) == []
    assert Alone().frozen(speed_rad_s=900.0) == ["shaft_power_not_ok"]
    assert Alone().frozen(shaft_power_W=100.0) == []
    assert Alone().frozen(shaft_power_W=300.0) == ["oil_outlet_not_ok"]
    alive = Alone()
    alive.step(1.0, jitter=0.01)
    alive.speed_rad_s = 900.0
    assert alive.step(70.0, jitter=0.01) == []


def test_a_slow_drift_is_believed_to_the_end_of_the_range() -> None:
    alone, told = Alone(), []
    while alone.values["oil_outlet_C"] < 152.0:
        alone.values["oil_outlet_C"] += 0.5
        told += alone.step()
    assert told == ["oil_outlet_not_ok"]
    assert alone.values["oil_outlet_C"] > 150.0


def test_the_clearance_may_go_at_its_rate_and_over_a_wrap_of_the_clock() -> None:
    alone = Alone()
    alone.count = 2**32 // 50_000 - 3
    for _ in range(20):
        alone.values["clearance_actual_um"] += 2.5
        assert alone.step() == []


def test_a_node_that_starts_again_is_judged_anew() -> None:
    alone = Alone()
    alone.step(1.0)
    assert alone.stage.step([], None, -(1 << 62), None, 0.0, alone.now_ns) == []
    assert alone.stage.known() is None
    assert alone.stage.smaller_clearance_um(None) == 50.0
    alone.values["clearance_actual_um"] = 120.0
    assert alone.step() == []


def test_the_channel_counts_only_while_it_is_ok_and_fresh() -> None:
    stage = Readings(bench())
    samples = np.full((30, 8), 1500, "<i2").tobytes()
    block = Block(0, 0, 200_000, 0, 200, 0, 0xFF, 600.0, 0, [], samples)
    stage.step([block], None, 0, None, 600.0, 10**10)
    assert stage.pressure(10**10) == (pytest.approx(1.5), True)
    assert stage.pressure(10**10 + 300 * MS) == (None, False)
    stage.step(
        [msgspec.structs.replace(block, channel_ok=0xBF)], None, 0, None, 600.0, 10**10 + 60 * MS
    )
    assert stage.pressure(10**10 + 60 * MS) == (None, False)


SUPPLY_AT = 6
"""Place of the channel ``supply_pressure`` on the bench."""


class TwoSources(Alone):
    """Reading and channel of the pressure; a channel that is not OK has a bad contact."""

    def see(
        self, slow_bar: float, fast_bar: float, seconds: float = 0.05, channel: str = "ok"
    ) -> list[str]:
        self.values["pressure_actual_bar"] = slow_bar
        told = []
        for _ in range(round(seconds / 0.05)):
            counts = np.full((30, 8), round(1000 * fast_bar), "<i2").tobytes()
            block = Block(0, 0, 200_000, 0, 200, 0, 0xFF, 600.0, 0, [], counts)
            if channel != "ok":
                block = msgspec.structs.replace(
                    block,
                    channel_ok=0xFF & ~(1 << SUPPLY_AT),
                    channel_cause=cause_bits(SUPPLY_AT, ChannelCause.INTERMITTENT),
                    unusable=0 if channel == "clean" else 1 << SUPPLY_AT,
                )
            self.blocks = [block]
            told += self.step()
        return told

    @property
    def pressure(self) -> OilEvidence:
        return self.stage.pressure(self.now_ns)


def test_both_sources_bad_is_named_and_what_they_show_low_still_counts() -> None:
    two = TwoSources()
    assert two.see(1.0, 1.0, 2.0) == []
    assert two.pressure == (pytest.approx(1.0), True)
    assert two.see(1.0, 1.0, 1.0, "bad") == []
    assert two.pressure == (pytest.approx(1.0), False)
    assert two.see(9.0, 1.0, 0.6, "bad") == ["pressure_actual_not_ok", "pressure_unknown"]
    assert two.pressure == (None, False)
    assert two.see(0.1, 1.0, 0.05, "bad") == []
    assert two.pressure == (pytest.approx(0.1), False)
    assert two.see(9.0, 0.2, 0.05, "clean") == []
    assert two.pressure == (pytest.approx(0.2), False)
    assert "low supply pressure" in two.stage.doubts["pressure_unknown"]
    told = two.see(1.0, 1.0, 11.0)
    assert told == ["pressure_unknown_ended", "pressure_actual_not_ok_ended"]
    assert two.pressure == (pytest.approx(1.0), True)


def test_both_sources_bad_in_turn_with_good_ones_is_named() -> None:
    two, told = TwoSources(), []
    two.see(9.0, 1.0, 0.2)
    for _ in range(50):
        told += two.see(9.0, 1.0, 0.05, "bad") + two.see(9.0, 1.0, 0.05)
    assert told == ["pressure_unknown"]
    assert two.see(9.0, 1.0, 1.0) == ["pressure_unknown_ended"]


def test_a_source_that_is_gone_for_good_leaves_the_other() -> None:
    two = TwoSources()
    two.see(1.0, 1.0, 1.0)
    two.see(1.0, 1.0, 59.0, "bad")
    assert not two.pressure.whole
    two.see(1.0, 1.0, 2.0, "bad")
    assert two.pressure == (pytest.approx(1.0), True)


@pytest.mark.parametrize("between", ["agree", "channel away"])
def test_a_mismatch_that_comes_and_goes_adds_up_and_stays(between: str) -> None:
    two, told = TwoSources(), []
    two.see(1.0, 1.0, 1.0)
    for _ in range(60):
        told += two.see(1.0, 2.0, 0.15)
        told += two.see(1.0, 1.0, 0.1) if between == "agree" else two.see(1.0, 2.0, 0.1, "bad")
    assert told == ["pressure_mismatch"]
    assert two.stage.known() is None
    assert two.see(1.0, 1.0, 3.0) == ["pressure_mismatch_ended"]


def test_a_mismatch_ends_where_nothing_is_left_to_compare() -> None:
    two = TwoSources()
    assert two.see(1.0, 2.0, 3.0) == ["pressure_mismatch"]
    assert two.see(1.0, 2.0, 59.0, "bad") == []
    assert two.see(1.0, 2.0, 2.0, "bad") == ["pressure_mismatch_ended"]


def test_the_range_of_the_power_follows_the_machine_or_the_key() -> None:
    config = bench()
    assert 2000.0 < power_max_W(config) < 6000.0
    known = config.replaced(
        readings=msgspec.structs.replace(config.machine.readings, shaft_power_max_W=900.0)
    )
    assert Readings(known).rows[POWER].high == 900.0


def test_the_state_survives_encoding() -> None:
    alone = Alone()
    alone.values["oil_outlet_C"] = 300.0
    alone.step(1.0)
    state = alone.stage.state
    assert msgspec.msgpack.decode(msgspec.msgpack.encode(state), type=ReadingsState) == state
    assert [a.name for a in alone.stage.standing()] == ["oil_outlet_not_ok"]

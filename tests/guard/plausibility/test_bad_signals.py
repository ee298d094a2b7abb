"""Bad signals from samples to trip: channel OK by cause and protection together."""

from collections.abc import Callable
from math import pi

import msgspec
import numpy as np
import pytest

from firmware_py.acquire.channel_ok import ChannelOk
from firmware_py.config import Config
from firmware_py.guard.alarms.alarm import Notice
from firmware_py.guard.protection.vibration import Protection
from firmware_py.records import Block, Quality

from ..scripted_node import bench

PERIOD_US, N = 200, 30
RATE = 1e6 / PERIOD_US
RNG = np.random.default_rng(3)
X, Y, ACC, MOTOR = 0, 1, 2, 4
UM = 100.0
"""Counts per um, and per m/s2."""

Signal = Callable[[np.ndarray, np.ndarray], np.ndarray]
"""Counts from time (s) and turns."""


def sine(amplitude: float, order: float = 1.0, mean: float = 0.0, noise: float = 0.1) -> Signal:
    """``amplitude`` in um or m/s2."""
    return lambda t, turn: (
        UM * (mean + amplitude * np.cos(2 * pi * order * turn) + noise * RNG.normal(size=t.shape))
    )


def clipped(inner: Signal, high: float, low: float | None = None) -> Signal:
    low = -high if low is None else low
    return lambda t, turn: np.clip(inner(t, turn), UM * low, UM * high)


def pulses(inner: Signal, at: float, every_s: float, last_s: float, noise: float = 0.0) -> Signal:
    """A rail, or any level, now and then."""

    def signal(t: np.ndarray, turn: np.ndarray) -> np.ndarray:
        level = UM * (at + noise * RNG.normal(size=t.shape))
        return np.where(t % every_s < last_s, level, inner(t, turn))

    return signal


def random_pulses(inner: Signal, at: float, share: float) -> Signal:
    return lambda t, turn: np.where(RNG.random(t.shape) < share, UM * at, inner(t, turn))


class Machine:
    """Five seconds and more of a machine whose channels are what is asked."""

    def __init__(self, config: Config, rpm: float = 6000.0) -> None:
        self.config, self.rpm = config, rpm
        self.ok, self.protection = ChannelOk.of(config), Protection(config, [])
        self.signals: dict[int, Signal] = {
            i: sine(5.0) if i < 5 else sine(1.0, mean=10.0) for i in range(8)
        }
        self.lost: Callable[[int], bool] = lambda seq: False
        self.seq, self.notices, self.first = 0, list[str](), dict[str, float]()
        self.told = list[Notice]()

    def run(self, seconds: float, clearance_um: float = 140.0) -> "Machine":
        for _ in range(round(seconds * RATE / N)):
            n = np.arange(self.seq * N, self.seq * N + N)
            t, turn = n / RATE, n / RATE * self.rpm / 60
            missing = self.lost(self.seq)
            gap = self.seq > 0 and self.lost(self.seq - 1)
            self.seq += 1
            if missing:
                continue
            rows = np.column_stack(
                [np.clip(np.round(self.signals[i](t, turn)), -32768, 32767) for i in range(8)]
            )
            counts, speed = rows.astype(np.int16), self.rpm * pi / 30
            ok = self.ok.step(counts, speed, gap)
            block = Block(
                self.seq,
                round(t[0] * 1e9),
                PERIOD_US * 1000,
                0,
                PERIOD_US,
                int(Quality.GAP_BEFORE) * gap,
                ok,
                speed,
                0,
                [],
                counts.tobytes(),
                self.ok.state.causes,
                self.ok.state.unusable,
            )
            for notice in self.protection.step([block], clearance_um):
                self.notices.append(notice.name)
                self.told.append(notice)
                self.first.setdefault(notice.name, float(t[-1]))
        return self

    def cause(self, channel: str) -> str:
        return self.protection.causes.get(channel, "ok")


def machine(rpm: float = 6000.0, **signals: Signal) -> Machine:
    m = Machine(bench(), rpm)
    m.run(0.5)
    m.signals |= {int(name.removeprefix("ch")): signal for name, signal in signals.items()}
    return m


SATURATED = {
    "both sides at 1X": (6000.0, MOTOR, clipped(sine(250.0), 200.0)),
    "both sides at 2X": (6000.0, MOTOR, clipped(sine(250.0, 2.0), 200.0)),
    "low speed": (1500.0, MOTOR, clipped(sine(250.0), 200.0)),
    "slowest speed": (600.0, MOTOR, clipped(sine(250.0), 200.0)),
    "high speed": (12000.0, MOTOR, clipped(sine(250.0), 200.0)),
    "one side": (6000.0, ACC, clipped(sine(180.0, mean=60.0), 200.0)),
    "half rectified": (6000.0, ACC, clipped(sine(1e5), 200.0, 0.0)),
    "square": (6000.0, ACC, clipped(sine(1e5), 200.0)),
    "whirl": (6000.0, MOTOR, clipped(sine(230.0, 0.45), 200.0)),
    "fast whirl": (12000.0, MOTOR, clipped(sine(230.0, 0.48), 200.0)),
    "whirl of a displacement": (6000.0, X, clipped(sine(300.0, 0.45), 250.0)),
    "displacement at 1X": (6000.0, Y, clipped(sine(280.0), 250.0)),
    "displacement on one side": (6000.0, Y, clipped(sine(200.0, mean=100.0), 250.0)),
    "far beyond, at the ends of the wire": (6000.0, X, clipped(sine(1000.0), 327.0)),
}  # fmt: skip


NAMES = ["disp_x", "disp_y", "acc_bearing_vertical", "acc_bearing_horizontal", "acc_motor"]


@pytest.mark.parametrize("name", SATURATED)
def test_a_vibration_that_saturates_reaches_danger_in_its_time_and_is_named(name: str) -> None:
    rpm, channel, signal = SATURATED[name]
    m = machine(rpm, **{f"ch{channel}": signal}).run(2.0)
    assert m.protection.tripped == [f"{NAMES[channel]}_danger"]
    assert m.first[f"{NAMES[channel]}_danger"] < 0.5 + 1.0 + 0.2
    assert m.cause(NAMES[channel]) == "saturated"
    assert (
        next(a.value for a in m.protection.standing() if a.name == f"{NAMES[channel]}_danger")
        >= 195.0
    )


def test_a_saturated_vibration_that_keeps_no_step_votes_as_measured() -> None:
    m = machine(6000.0, ch4=clipped(sine(300.0, 10.37), 200.0)).run(3.0)
    assert m.protection.tripped == ["acc_motor_danger"]
    assert m.cause("acc_motor") == "intermittent"


def test_both_probes_saturated_cost_authority_and_trip() -> None:
    m = machine(6000.0, ch0=clipped(sine(280.0), 250.0), ch1=clipped(sine(270.0), 250.0)).run(4.0)
    assert m.protection.tripped == ["disp_x_danger", "disp_y_danger"]
    assert not m.protection.displacement_ok


@pytest.mark.parametrize(
    ("danger", "alert", "tripped"),
    [(190.0, 150.0, True), (250.0, 190.0, False), (250.0, 240.0, False)],
)
def test_a_rail_below_the_limit_still_counts_as_the_rail_and_is_named(
    danger: float, alert: float, tripped: bool
) -> None:
    config = bench()
    limits = msgspec.structs.replace(
        config.limits, acceleration_danger_m_s2=danger, acceleration_alert_m_s2=alert
    )
    m = Machine(config.replaced(limits=limits)).run(0.5)
    m.signals[MOTOR] = clipped(sine(220.0), 200.0)
    m.run(4.0)
    assert m.protection.tripped == ["acc_motor_danger"] * tripped
    assert ("acc_motor_alert" in m.notices) == (alert < 195.0)
    named = next(n for n in m.told if n.name == "acc_motor_saturated")
    assert ("lies beyond what it can show" in named.text) == (danger > 195.0)
    assert [a.value for a in m.protection.standing() if a.name == "acc_motor_saturated"] == [195.0]


BAD_CONTACT = {
    "a rail now and then": (ACC, 4.0, pulses(sine(8.0), 200.0, 0.9, 0.012)),
    "a noisy rail now and then": (ACC, 4.0, pulses(sine(8.0), 200.0, 0.9, 0.012, 2.0)),
    "a rail at random": (ACC, 4.0, random_pulses(sine(8.0), 200.0, 0.004)),
    "opens for 5 ms a second": (X, 4.0, pulses(sine(8.0), 250.0, 1.0, 0.005)),
    "opens often": (X, 4.0, pulses(sine(8.0), 250.0, 0.03, 0.002)),
    "opens in step with the shaft by chance": (X, 4.0, pulses(sine(8.0), 250.0, 0.01, 0.002)),
    "opens at random": (X, 4.0, random_pulses(sine(8.0), 250.0, 0.02)),
    "spikes inside the range": (X, 4.0, random_pulses(sine(8.0), 150.0, 0.002)),
    "drops to zero": (X, 4.0, pulses(sine(8.0, mean=-60.0), 0.0, 0.05, 0.004)),
    "drops to zero for long": (X, 4.0, pulses(sine(8.0, mean=-60.0), 0.0, 0.4, 0.1)),
    "drops to zero at random": (Y, 4.0, random_pulses(sine(8.0, mean=-60.0), 0.0, 0.05)),
}  # fmt: skip


@pytest.mark.parametrize("name", BAD_CONTACT)
def test_a_bad_contact_is_named_and_trips_nothing_on_a_calm_machine(name: str) -> None:
    channel, seconds, signal = BAD_CONTACT[name]
    m = machine(6000.0, **{f"ch{channel}": signal}).run(seconds)
    assert m.cause(NAMES[channel]) == "intermittent"
    assert m.protection.tripped == []
    assert set(m.notices) == {f"{NAMES[channel]}_not_ok"}
    assert m.protection.displacement_ok == (channel == ACC)


BEHIND = {
    "a rail now and then": (ACC, pulses(sine(140.0), 200.0, 0.9, 0.012)),
    "a rail often": (ACC, pulses(sine(140.0), -200.0, 0.3, 0.03)),
    "barely touched": (MOTOR, clipped(sine(194.5, noise=1.0), 200.0)),
    "opens for 5 ms a second": (X, pulses(sine(48.0), 250.0, 1.0, 0.005)),
    "opens often": (X, pulses(sine(48.0), 250.0, 0.05, 0.002)),
    "flat for a tenth of a second": (ACC, pulses(sine(140.0), 3.0, 0.4, 0.1)),
    "zero for a tenth of a second": (X, pulses(sine(48.0), 0.0, 0.4, 0.1)),
    "open for a fifth of a second": (ACC, pulses(sine(140.0), 200.0, 4.0, 0.2)),
}  # fmt: skip


@pytest.mark.parametrize("name", BEHIND)
def test_a_vibration_behind_a_bad_contact_still_trips(name: str) -> None:
    channel, signal = BEHIND[name]
    m = machine(6000.0, **{f"ch{channel}": signal}).run(3.0)
    assert m.protection.tripped == [f"{NAMES[channel]}_danger"]


@pytest.mark.parametrize("noise", [0.0, 0.1, 1.0])
@pytest.mark.parametrize(("channel", "rail"), [(X, 250.0), (Y, -250.0), (ACC, 200.0), (X, 327.0)])
def test_an_open_cable_leaves_the_vote(channel: int, rail: float, noise: float) -> None:
    m = machine(6000.0, **{f"ch{channel}": sine(0.0, mean=rail, noise=noise)}).run(0.13)
    assert m.cause(NAMES[channel]) == "open"
    m.run(2.0)
    assert m.cause(NAMES[channel]) == "open"
    assert m.protection.tripped == []
    m.signals[channel] = sine(5.0)
    m.run(0.99)
    assert m.cause(NAMES[channel]) != "ok"


@pytest.mark.parametrize("bad", [sine(0.0, mean=250.0), sine(0.0, mean=12.0, noise=0.0)])
@pytest.mark.parametrize("away_s", [0.5, 3.0])
def test_a_danger_timer_goes_on_where_it_was_after_the_channel_was_away(
    bad: Signal, away_s: float
) -> None:
    m = machine(6000.0, ch0=sine(48.0)).run(0.7)
    m.signals[X] = bad
    m.run(away_s)
    m.signals[X] = sine(48.0)
    m.run(1.7)
    assert m.protection.tripped == ["disp_x_danger"]


LOSSES = {
    "every third block": lambda seq: seq % 3 == 0,
    "every second block": lambda seq: seq % 2 == 0,
    "four of five blocks": lambda seq: seq % 5 != 0,
    "half of each fifth of a second": lambda seq: seq % 34 < 17,
    "a second now and then": lambda seq: seq % 250 < 167,
    "one block in ten": lambda seq: seq % 10 == 0,
}


@pytest.mark.parametrize("name", LOSSES)
@pytest.mark.parametrize(("channel", "amplitude"), [(X, 48.0), (MOTOR, 140.0)])
def test_data_lost_during_danger_puts_the_trip_off_by_what_is_lost_and_no_more(
    name: str, channel: int, amplitude: float
) -> None:
    m = machine(6000.0, **{f"ch{channel}": sine(amplitude)})
    m.lost = LOSSES[name]
    m.run(8.0)
    assert m.protection.tripped == [f"{NAMES[channel]}_danger"]


@pytest.mark.parametrize("name", LOSSES)
def test_data_lost_on_a_calm_machine_trips_nothing(name: str) -> None:
    m = machine(6000.0)
    m.lost = LOSSES[name]
    assert m.run(3.0).notices == []


def test_channels_that_are_bad_in_turn_still_trip() -> None:
    def away(inner: Signal, second: int) -> Signal:
        return lambda t, turn: np.where(np.floor(t) % 4 // 2 == second, UM * 250.0, inner(t, turn))

    m = machine(6000.0, ch0=away(sine(48.0), 0), ch1=away(sine(48.0), 1)).run(9.0)
    assert set(m.protection.tripped) == {"disp_x_danger", "disp_y_danger"}


def test_a_slow_drift_to_the_rail_ends_as_open_without_a_trip() -> None:
    def drifting(t: np.ndarray, turn: np.ndarray) -> np.ndarray:
        return np.minimum(
            UM * (60.0 * t + 6.0 * np.cos(2 * pi * turn) + 0.1 * RNG.normal(size=t.shape)),
            UM * 250.0,
        )

    m = machine(6000.0, ch0=drifting).run(9.0)
    assert m.cause("disp_x") == "open"
    assert m.protection.tripped == []


def test_a_gap_beyond_the_range_that_still_alternates_votes_as_measured() -> None:
    m = machine(6000.0, ch0=sine(45.0, mean=300.0)).run(3.0)
    assert m.cause("disp_x") == "beyond"
    assert m.protection.tripped == ["disp_x_danger"]


def test_an_intermittent_channel_is_ok_after_thirty_clean_seconds() -> None:
    m = machine(6000.0, ch0=pulses(sine(8.0), 250.0, 0.05, 0.002)).run(0.2)
    m.signals[X] = sine(8.0)
    m.run(29.8)
    assert m.cause("disp_x") == "intermittent"
    m.run(0.3)
    assert m.cause("disp_x") == "ok"
    assert m.notices[-1] == "disp_x_ok"


def test_microphone_and_contact_resistance_may_touch_their_rails() -> None:
    touching = pulses(sine(1.0, mean=10.0), 300.0, 0.7, 0.0012)
    m = machine(6000.0, ch5=touching, ch7=touching)
    assert m.run(3.0).notices == []


def test_the_memory_of_a_channel_survives_a_snapshot() -> None:
    m = machine(6000.0, ch0=sine(48.0)).run(0.7)
    other = Machine(m.config)
    other.seq, other.signals = m.seq, m.signals
    other.protection.state = msgspec.msgpack.decode(
        msgspec.msgpack.encode(m.protection.state), type=type(m.protection.state)
    )
    other.ok.state = msgspec.msgpack.decode(
        msgspec.msgpack.encode(m.ok.state), type=type(m.ok.state)
    )
    other.run(0.5)
    assert other.protection.tripped == ["disp_x_danger"]

"""The whole rig as a stage: what it says, when, and how it answers what it hears."""

from collections import defaultdict
from itertools import pairwise

import numpy as np
import pytest

from firmware_py.config import SHIPPED, load
from firmware_py.records import (
    Command,
    DeviceHeartbeat,
    NodeInfo,
    NodeMode,
    NodeState,
    RawFrame,
    Rejected,
    RigStatus,
    SampleFrame,
    WireMessage,
)
from firmware_py.wire.codec import CanCodec
from firmware_py.wire.layout_fields import SampleFlag
from sim_hil.hil.rig import GIVE_UP_MS, Rig
from sim_hil.rigs import load_rig
from sim_hil.server import make_rig

MS = 1_000_000
CODEC = CanCodec()
CONFIG, _ = load(SHIPPED / "bench")


def bench(seed: int = 1) -> Rig:
    return make_rig(CONFIG, "bench", seed)


class Bench:
    """A rig on a simulated clock and everything that it said, decoded."""

    def __init__(self, seed: int = 1) -> None:
        self.rig = bench(seed)
        self.now_ns = 10**12
        self.frames: list[RawFrame] = []
        self.said: defaultdict[type, list[WireMessage]] = defaultdict(list)
        self.step(0)

    def step(self, ms: float = 1, *messages: WireMessage) -> None:
        self.now_ns += round(ms * MS)
        out = self.rig.step(self.now_ns, [CODEC.encode(m, self.now_ns) for m in messages])
        self.frames += out
        for frame in out:
            message = CODEC.decode(frame)
            assert not isinstance(message, Rejected)
            self.said[type(message)].append(message)

    def run(self, ms: int) -> None:
        for _ in range(ms):
            self.step()

    def samples(self) -> list[SampleFrame]:
        return [m for m in self.said[SampleFrame] if isinstance(m, SampleFrame)]

    def state(self) -> NodeState:
        last = self.said[NodeState][-1]
        assert isinstance(last, NodeState)
        return last

    def heartbeat(self, permit: bool = True, trip: bool = False) -> DeviceHeartbeat:
        return DeviceHeartbeat(0, 7, 2, 3, permit, trip)


def test_every_message_comes_at_its_period() -> None:
    b = Bench()
    b.run(2010)
    expected = {SampleFrame: 3350, RigStatus: 40, NodeState: 40, NodeInfo: 2}
    for kind, count in expected.items():
        assert len(b.said[kind]) == pytest.approx(count, abs=1)
        counters = [m.counter for m in b.said[kind]]
        assert counters == list(range(len(counters)))


def test_sample_ticks_follow_without_a_gap_and_marks_are_in_order() -> None:
    b = Bench()
    b.run(300)
    frames = b.samples()
    assert {(later.tick_us - earlier.tick_us) % 2**32 for earlier, later in pairwise(frames)} == {
        600
    }
    valid = [f for f in frames if f.flags & SampleFlag.MARK_VALID]
    assert len(valid) > 400
    for f in valid:
        assert (
            0 <= (f.tick_us + 400 - f.mark_tick_us) % 2**32 <= 10_500
        )  # within one turn of the last instant
    assert [f.turn_count for f in valid] == sorted(f.turn_count for f in valid)


def test_node_info_is_that_of_the_configuration() -> None:
    b = Bench()
    b.run(1010)
    info = b.said[NodeInfo][0]
    assert isinstance(info, NodeInfo)
    assert info.sample_period_us == CONFIG.sampling.period_us
    assert info.boot_clearance_um == CONFIG.machine.actuator.safe_radial_clearance_um
    assert info.boot_pressure_bar == CONFIG.machine.actuator.safe_pressure_bar
    assert info.time_to_live_ms == CONFIG.machine.actuator.time_to_live_ms
    assert info.rate_um_s == pytest.approx(CONFIG.machine.actuator.rate_um_s)


def test_same_seed_same_bytes() -> None:
    first, again, other = Bench(3), Bench(3), Bench(4)
    for b in (first, again, other):
        b.run(50)
    assert first.frames == again.frames
    assert first.frames != other.frames


def test_follows_commands_at_its_rate_and_returns_when_they_stop() -> None:
    b = Bench()
    b.run(100)
    for counter in range(1, 61):
        b.step(20, Command(counter, 7, b.samples()[-1].tick_us, 60.0, 2.0))
    assert b.state().mode == NodeMode.FOLLOWING
    assert 58 <= b.state().command_counter <= 60
    reached = b.rig.truth[-1].clearance_um
    assert reached == pytest.approx(60.0 + b.rig.machine.wear_m * 1e6, abs=1.1)
    assert b.rig.truth[-1].pressure_bar == pytest.approx(2.0, abs=0.05)
    b.run(200)
    assert b.state().mode == NodeMode.SAFE
    assert b.state().target_clearance_um == 50.0
    assert not b.state().at_target
    b.run(1500)  # the pressure needs its dead time, slew and lag
    assert b.state().at_target


def test_damaged_and_stale_commands_are_counted() -> None:
    b = Bench()
    b.run(100)
    good = CODEC.encode(Command(1, 7, b.samples()[-1].tick_us, 60.0, 2.0))
    bad = RawFrame(0, good.frame_id, good.data[:-1] + bytes([good.data[-1] ^ 1]))
    b.rig.step(b.now_ns, [bad])
    b.step(1, Command(2, 7, (b.samples()[-1].tick_us - 200_000) % 2**32, 60.0, 2.0))
    assert b.rig.node.refused == {"stale": 1, "check": 1, "session": 0, "range": 0}


def test_trip_coasts_down_and_the_samples_say_so() -> None:
    b = Bench()
    b.step(1, b.heartbeat())
    b.run(20)
    assert not b.samples()[-1].flags & SampleFlag.COASTING
    b.step(1, b.heartbeat(trip=True))
    b.run(100)
    assert b.samples()[-1].flags & SampleFlag.COASTING
    assert b.rig.drive.speed_rad_s < 628.3 - 14
    assert b.rig.drive.reason == "trip request"


def test_lost_heartbeat_coasts_down() -> None:
    b = Bench()
    b.step(1, b.heartbeat())
    b.run(2999)
    assert not b.rig.drive.coasting
    b.run(20)
    assert b.rig.drive.coasting


def test_a_rig_behind_real_time_says_so_and_catches_up() -> None:
    b = Bench()
    b.run(10)
    b.step(100)
    assert b.samples()[-1].flags & SampleFlag.BEHIND
    assert b.rig.lag_ms_max == pytest.approx(100, abs=1)
    b.step(1)
    assert not b.samples()[-1].flags & SampleFlag.BEHIND
    assert {(y.tick_us - x.tick_us) % 2**32 for x, y in pairwise(b.samples())} == {600}


def test_a_stopped_rig_leaves_the_time_out_whole_frames_with_their_counters() -> None:
    b = Bench()
    b.run(10)
    before = b.samples()[-1]
    b.step(GIVE_UP_MS + 1500)
    b.run(5)
    after = b.samples()[-1]
    frames = (after.counter - before.counter) % 65536
    assert (after.tick_us - before.tick_us) % 2**32 == frames * 600
    assert frames > 3000
    assert len(b.samples()) < 50
    assert b.rig.periods_left_out >= 9995


def test_commands_judged_by_the_real_time_after_a_stop() -> None:
    b = Bench()
    b.run(100)
    old = b.samples()[-1].tick_us
    b.step(2000, Command(1, 7, old, 60.0, 2.0))
    assert b.rig.node.refused["stale"] == 1


def test_truth_is_one_entry_per_tenth_of_a_second() -> None:
    b = Bench()
    b.run(1005)
    assert len(b.rig.truth) == 10
    last = b.rig.truth[-1]
    assert last.speed_rad_s == pytest.approx(628.3, rel=1e-3)
    assert 0 < last.min_film_um < last.clearance_um
    b.rig.inject("unbalance", 16.0)
    b.run(110)
    assert b.rig.truth[-1].faults == {"unbalance": 16.0}
    assert b.rig.truth[-1].unbalance_kg_m > last.unbalance_kg_m
    b.rig.clear()
    b.run(110)
    assert b.rig.truth[-1].faults == {}


def test_status_errors_are_within_the_data_sheet() -> None:
    errors = []
    for seed in range(4):
        b = Bench(seed)
        b.run(210)
        status, truth = b.said[RigStatus][-1], b.rig.truth[-1]
        assert isinstance(status, RigStatus)
        errors.append(status.shaft_power_W - truth.power_W)
        assert abs(status.oil_outlet_C - truth.oil_C) <= 1.05
        assert (
            abs(status.clearance_actual_um - truth.clearance_um + b.rig.machine.wear_m * 1e6) < 1.5
        )
    assert max(map(abs, errors)) <= 5.5
    assert np.std(errors) > 0.1


def test_operating_point_is_approached_in_the_given_time() -> None:
    b = Bench()
    b.rig.set_operating(9000, 200, 0.8)
    b.run(400)
    assert b.rig.drive.load_N == pytest.approx(150, abs=1)
    b.run(500)
    assert b.rig.drive.load_N == 200
    assert b.rig.drive.speed_rad_s == pytest.approx(9000 * np.pi / 30)


def test_seed_rig_runs_too() -> None:
    from sim_hil.hil.node import NodeLimits
    from sim_hil.plant.build import Build

    data = load_rig("seed")
    limits = NodeLimits(60.0, 4.0, (50.0, 95.0), (3.3, 5.4), 100, 50.0)
    rig = Rig(data, CODEC, limits, 1, build=Build.of_seed(data, 1))
    rig.set_operating(3000, 5, 0.0)
    for i in range(300):
        rig.step(i * MS, [])
    assert 0 < rig.truth[-1].min_film_um < 95


def test_the_nodes_clock_drifts_within_its_data_sheet() -> None:
    """Node time after 8 s of host time: at most 50 ppm off (to one period of 0.2 ms), and each node
    in its own way."""
    node_s = []
    for seed in (0, 2):
        b = Bench(seed)
        for _ in range(400):
            b.step(20)
        node_s.append(b.rig.time_s)
    for time_s in node_s:
        assert abs(time_s - 8.0) <= 8.0 * 50e-6 + 0.2e-3
    assert node_s[1] - node_s[0] >= 0.4e-3


@pytest.mark.parametrize("name", ["bench", "seed"])
def test_a_rig_starts_within_what_its_shipped_configuration_declares(name: str) -> None:
    """A rig that starts faster trips speed-high before anybody can tell it otherwise."""
    config = load(SHIPPED / name)[0]
    rig, operating = make_rig(config, name, 3), config.machine.operating
    for step in range(1, 300):
        rig.step(step * MS, [])
    truth = rig.truth[0]
    assert operating.speed_min_rpm <= truth.speed_rad_s * 30 / np.pi <= operating.speed_max_rpm
    assert operating.load_min_N <= truth.load_N <= operating.load_max_N

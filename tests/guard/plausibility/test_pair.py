"""The probe pair against the machine: wiring, order, sign, gain, zero, at other angles and with
offsets."""

from collections.abc import Callable
from math import cos, pi, radians, sin

import msgspec
import numpy as np
import pytest

from firmware_py.config import Config
from firmware_py.guard.core import GuardCore
from firmware_py.guard.envelope.load_estimate import LoadEstimator, Look
from firmware_py.guard.measurement.motion import MotionMeter
from firmware_py.guard.plausibility.pair import BAD_LEAST, GOOD_LEAST, PairCheck
from firmware_py.machine.film import static_film
from firmware_py.machine.lubricant import viscosity_Pa_s
from firmware_py.records import Block, ChannelCause, CommandRequest, Cycle, Quality, cause_bits
from firmware_py.wire.codec import CanCodec

from ..scripted_node import MS, Bench, ScriptedNode, bench

N, PERIOD_US = 30, 200
RATE = 1e6 / PERIOD_US
ANGLES = [
    (45.0, 135.0),
    (30.0, 120.0),
    (0.0, 90.0),
    (-45.0, 45.0),
    (135.0, 45.0),
    (45.0, 105.0),
    (10.0, 150.0),
]

SHORT_ANGLES = {ANGLES[0], ANGLES[4], ANGLES[6]}
"""Of the default run; `make test-slow` takes all."""

Distort = Callable[[np.ndarray, np.ndarray], np.ndarray]
"""Probe readings in um, shape (n, 2), and time, to what the channels read."""


def with_probes(
    first_deg: float = 45.0,
    second_deg: float = 135.0,
    offset_um: tuple[float, float] = (0.0, 0.0),
    sign: float = 1.0,
    zeroed: bool = False,
) -> Config:
    config = bench()
    probes = [
        msgspec.structs.replace(
            c, angle_deg=a, offset=o * 1e-6, scale=sign * c.scale, zeroed=zeroed
        )
        for c, a, o in zip(config.machine.channel, (first_deg, second_deg), offset_um, strict=False)
    ]
    return config.replaced(channel=[*probes, *config.machine.channel[2:]])


def place_um(config: Config, eccentricity: float, clearance_um: float) -> tuple[float, float]:
    """Where the film holds the journal."""
    film = static_film(config.machine.bearing.journal_radius_m, config.machine.bearing.length_m)
    k = min(range(len(film.eccentricity)), key=lambda i: abs(film.eccentricity[i] - eccentricity))
    e = film.eccentricity[k] * clearance_um
    return e * film.sine[k], -e * film.cosine[k]


class Bearing:
    """A journal at rest in the film, with an orbit; 6000 rpm and 80 um unless changed."""

    def __init__(self, config: Config, eccentricity: float = 0.5) -> None:
        self.config, self.eccentricity = config, eccentricity
        self.meter, self.pair = MotionMeter(config), PairCheck(config)
        self.rpm, self.clearance_um, self.oil_C, self.orbit_um = 6000.0, 80.0, 40.0, 3.0
        self.ellipse = 1.0
        self.place_um: tuple[float, float] | None = None
        self.distort: Distort = lambda seen, t: seen
        self.seq, self.quality, self.cause = 0, 0, 0
        self.rng = np.random.default_rng(5)
        self.names: list[str] = []
        self.first: dict[str, float] = {}
        self.block: Block | None = None

    def run(self, seconds: float) -> "Bearing":
        x0, y0 = self.place_um or place_um(self.config, self.eccentricity, self.clearance_um)
        probes = self.config.machine.channel[:2]
        for _ in range(round(seconds * RATE / N)):
            t = (self.seq * N + np.arange(N)) / RATE
            phase = 2 * pi * self.rpm / 60 * t
            x, y = (
                x0 + self.orbit_um * np.cos(phase),
                y0 + self.ellipse * self.orbit_um * np.sin(phase),
            )
            axes = np.array(
                [[cos(radians(p.angle_deg)), sin(radians(p.angle_deg))] for p in probes]
            )
            seen = np.column_stack([x, y]) @ axes.T + 0.1 * self.rng.normal(size=(N, 2))
            read = self.distort(seen, t)
            rows = np.zeros((N, 8), np.int16)
            for i, p in enumerate(probes):
                rows[:, i] = np.round((read[:, i] * 1e-6 - p.offset) / p.scale)
            self.block = Block(
                self.seq,
                self.seq * N * PERIOD_US * 1000,
                PERIOD_US * 1000,
                0,
                PERIOD_US,
                self.quality,
                0xFF,
                self.rpm * pi / 30,
                0,
                [],
                rows.tobytes(),
                self.cause,
            )
            self.motion = self.meter.step(self.block)
            facts = self.pair.facts(self.clearance_um * 1e-6, self.oil_C)
            for notice in self.pair.step(
                self.block, facts, max(self.motion.peak_to_peak_um) * 1e-6
            ):
                self.names.append(notice.name)
                self.first.setdefault(notice.name, float(t[-1]))
            self.seq += 1
        return self


@pytest.mark.parametrize(
    "angles", [a if a in SHORT_ANGLES else pytest.param(a, marks=pytest.mark.slow) for a in ANGLES]
)
@pytest.mark.parametrize(
    ("offset_um", "sign"),
    [
        ((0.0, 0.0), 1.0),
        ((-150.0, 60.0), -1.0),
        pytest.param((0.0, 0.0), -1.0, marks=pytest.mark.slow),
        pytest.param((-150.0, 60.0), 1.0, marks=pytest.mark.slow),
    ],
)
def test_any_angle_offset_and_sign_of_scale_give_the_position_and_a_plausible_pair(
    angles: tuple[float, float], offset_um: tuple[float, float], sign: float
) -> None:
    config = with_probes(*angles, offset_um, sign)
    b = Bearing(config).run(BAD_LEAST + 0.2)
    assert (b.motion.mean_x_m * 1e6, b.motion.mean_y_m * 1e6) == pytest.approx(
        place_um(config, 0.5, 80.0), abs=0.3
    )
    assert b.names == []
    look = Look(1.0, b.motion.mean_x_m, b.motion.mean_y_m, 6e-6, 80e-6, 6000.0 * pi / 30, 40.0, 0.0)
    film = static_film(config.machine.bearing.journal_radius_m, config.machine.bearing.length_m)
    load_N = (
        film.load_per_viscous_speed(0.5, 80e-6)
        * viscosity_Pa_s(config.machine.lubricant, 40.0)
        * 6000.0
        * pi
        / 30
    )
    found = LoadEstimator(config).estimate(look)
    assert found.measured
    assert found.low_N < load_N < found.high_N


FAULTS: dict[str, Distort] = {
    "gain of the first 0.2": lambda s, t: s * [0.2, 1.0],
    "gain of the second 0.2": lambda s, t: s * [1.0, 0.2],
    "gain of both 0.2": lambda s, t: s * 0.2,
    "gain of both 3": lambda s, t: s * 3.0,
    "swapped": lambda s, t: s[:, ::-1],
    "first copied from second": lambda s, t: s[:, [1, 1]],
    "second copied from first": lambda s, t: s[:, [0, 0]],
    "second is the first reversed": lambda s, t: s[:, [0, 0]] * [1.0, -1.0],
    "sign of the first": lambda s, t: s * [-1.0, 1.0],
    "sign of the second": lambda s, t: s * [1.0, -1.0],
    "both signs": lambda s, t: -s,
    "offset": lambda s, t: s + np.array([25.0, 0.0]),
    "drift": lambda s, t: s + np.column_stack([8.0 * np.maximum(t - 1.0, 0.0), 0.0 * t]),
}


@pytest.mark.parametrize("name", FAULTS)
@pytest.mark.parametrize(
    ("angles", "eccentricity"),
    [
        ((45.0, 135.0), 0.85),
        pytest.param((0.0, 105.0), 0.35, marks=pytest.mark.slow),
        pytest.param((45.0, 135.0), 0.35, marks=pytest.mark.slow),
        pytest.param((0.0, 105.0), 0.85, marks=pytest.mark.slow),
    ],
)
def test_a_fault_that_comes_while_it_runs_is_found_in_five_seconds(
    angles: tuple[float, float], name: str, eccentricity: float
) -> None:
    b = Bearing(with_probes(*angles), eccentricity)
    b.rpm, b.clearance_um = (6000.0, 100.0) if eccentricity < 0.5 else (3000.0, 100.0)
    b.run(1.1)
    assert b.names == []
    b.distort = FAULTS[name]
    b.run(5.0)
    assert b.names, name
    assert not b.pair.plausible
    assert {a.name for a in b.pair.standing()} == set(b.names)
    assert all("wiring" in a.text for a in b.pair.standing())


@pytest.mark.parametrize(
    "name", ["swapped", "sign of the first", "first copied from second", "both signs"]
)
def test_wrong_from_the_start_is_found_as_well(name: str) -> None:
    b = Bearing(with_probes())
    b.distort = FAULTS[name]
    assert b.run(5.0).names


def test_an_orbit_against_the_rotation_is_found_without_a_steady_film() -> None:
    b = Bearing(with_probes())
    b.orbit_um, b.ellipse, b.oil_C = 14.0, -1.0, 327.0
    assert b.run(4.5).names == ["disp_pair_backward"]


@pytest.mark.parametrize("ellipse", [1.0, 0.3, 0.1, -0.2])
def test_a_flat_orbit_or_a_small_one_is_no_fault(ellipse: float) -> None:
    b = Bearing(with_probes())
    b.orbit_um, b.ellipse = 10.0, ellipse
    assert b.run(6.0).names == []


def test_a_mean_outside_the_clearance_is_found_while_the_film_is_not_at_rest() -> None:
    b = Bearing(with_probes())
    b.distort = lambda s, t: s + np.array([90.0, 0.0])
    b.orbit_um, b.clearance_um = 26.0, 80.0
    assert "disp_pair_outside" in b.run(4.5).names


def shifted(um: float) -> Distort:
    return lambda s, t: s + np.array([um, 0.0])


def test_another_zero_from_the_start_in_a_round_orbit_is_left_to_the_load_until_it_moves() -> None:
    b = Bearing(with_probes())
    b.distort = shifted(-25.0)
    assert b.run(6.0).names == []
    b.distort = shifted(-45.0)
    assert b.run(5.0).names == ["disp_pair_position"]


@pytest.mark.parametrize(
    ("zeroed", "um", "ellipse"), [(True, -25.0, 1.0), (False, -60.0, 1.0), (False, -25.0, 0.8)]
)
def test_a_position_off_the_film_from_the_start_is_named_where_no_zero_explains_it(
    zeroed: bool, um: float, ellipse: float
) -> None:
    b = Bearing(with_probes(zeroed=zeroed))
    b.distort, b.ellipse = shifted(um), ellipse
    assert b.run(4.5).names == ["disp_pair_position"]


@pytest.mark.parametrize("cause", [ChannelCause.INTERMITTENT, ChannelCause.STUCK])
def test_the_clean_seconds_of_a_bad_contact_are_judged_and_those_of_a_channel_that_is_out_are_not(
    cause: ChannelCause,
) -> None:
    b = Bearing(with_probes())
    b.distort, b.cause = FAULTS["swapped"], cause_bits(1, cause)
    assert b.run(4.5).names == (
        ["disp_pair_position"] if cause == ChannelCause.INTERMITTENT else []
    )


@pytest.mark.parametrize("bad", ["gap", "cause", "mark", "slow", "clearance", "oil"])
def test_a_window_with_bad_quality_says_nothing(bad: str) -> None:
    b = Bearing(with_probes())
    b.distort = FAULTS["swapped"]
    b.orbit_um = 0.5
    if bad == "gap":
        b.quality = int(Quality.GAP_BEFORE)
    elif bad == "mark":
        b.quality = int(Quality.NO_MARK)
    elif bad == "cause":
        b.cause = cause_bits(1, ChannelCause.STUCK)
    elif bad == "slow":
        b.rpm = 600.0
    elif bad == "clearance":
        b.clearance_um = 200.0
    else:
        b.oil_C = 327.0
    assert b.run(6.0).names == []


@pytest.mark.parametrize("bad", ["gap", "cause", "mark"])
def test_one_bad_block_in_every_window_does_not_keep_the_pair_from_being_judged(bad: str) -> None:
    for name in ("swapped", "backward"):
        b = Bearing(with_probes())
        b.distort = FAULTS["swapped"] if name == "swapped" else lambda s, t: -s[:, ::-1]
        b.orbit_um = 12.0
        for _ in range(12):
            b.quality, b.cause = 0, 0
            b.run(0.9)
            b.quality = int(
                Quality.GAP_BEFORE if bad == "gap" else Quality.NO_MARK if bad == "mark" else 0
            )
            b.cause = cause_bits(1, ChannelCause.STUCK) if bad == "cause" else 0
            b.run(0.006)
        assert b.names


def test_a_good_orbit_with_gaps_is_none() -> None:
    b = Bearing(with_probes())
    b.orbit_um = 12.0
    for k in range(60):
        b.quality = 0
        b.run(0.15 + 0.006 * (k % 5))
        b.quality = int(Quality.GAP_BEFORE)
        b.run(0.006)
    assert b.names == []


def test_a_place_that_is_wrong_half_of_the_time_adds_up() -> None:
    b = Bearing(with_probes())
    for k in range(26):
        b.distort = FAULTS["both signs"] if k % 2 else lambda s, t: s
        b.run(334 * N / RATE)  # two windows: the first holds the jump and says nothing
    assert b.names[0] == "disp_pair_position"


def at_rest(
    gain: float, clearance_um: float, zeroed: bool = False, zero_um: float = 0.0
) -> Bearing:
    """A shaft that lies on the wall, a little beside the bottom."""
    b = Bearing(with_probes(zeroed=zeroed))
    b.rpm, b.orbit_um, b.clearance_um = 0.0, 0.0, clearance_um
    x_um, y_um = 0.2 * clearance_um, -(0.96**0.5) * clearance_um
    b.place_um = (gain * x_um, gain * y_um + zero_um)
    b.run(16.0)
    return b


@pytest.mark.parametrize(
    ("gain", "clearance_um", "zeroed", "named"),
    [
        (1.0, 50.0, False, False),
        (1.03, 160.0, False, False),
        (0.2, 50.0, False, True),
        (0.5, 80.0, False, True),
        (0.5, 50.0, False, False),
        (0.8, 50.0, True, True),
        (1.01, 50.0, True, False),
    ],
)
def test_a_shaft_at_rest_off_the_wall_tells_an_equal_loss_of_both_gains(
    gain: float, clearance_um: float, zeroed: bool, named: bool
) -> None:
    assert at_rest(gain, clearance_um, zeroed).names == ["disp_pair_rest"] * named


def test_a_zero_far_off_is_named_at_rest_and_stays_while_the_shaft_runs() -> None:
    assert at_rest(1.0, 50.0, zero_um=25.0).names == []
    b = at_rest(1.0, 50.0, zero_um=-45.0)
    assert b.names == ["disp_pair_rest"]
    b.place_um, b.rpm, b.orbit_um = None, 6000.0, 3.0
    b.run(12.0)
    assert not b.pair.plausible


def test_a_shaft_that_has_just_stopped_is_not_judged_yet() -> None:
    b = Bearing(with_probes())
    b.run(2.0)
    b.rpm, b.orbit_um = 0.0, 0.0
    b.run(9.0)
    assert b.names == []


def test_it_goes_only_after_ten_good_seconds_and_says_so_once() -> None:
    b = Bearing(with_probes())
    b.distort = FAULTS["both signs"]
    b.run(5.0)
    b.distort = lambda s, t: s
    b.run(GOOD_LEAST - 1.0)
    assert not b.pair.plausible
    b.run(3.0)
    assert b.pair.plausible
    assert b.names == ["disp_pair_position", "disp_pair_position_ok"]


def test_it_survives_a_snapshot() -> None:
    b, other = Bearing(with_probes()), Bearing(with_probes())
    b.distort = other.distort = FAULTS["both signs"]
    b.run(3.0)
    other.seq = b.seq
    other.pair.state = msgspec.msgpack.decode(
        msgspec.msgpack.encode(b.pair.state), type=type(b.pair.state)
    )
    assert other.run(1.2).names == b.run(1.2).names == ["disp_pair_position"]


class Wired(ScriptedNode):
    """A node whose probes can be changed."""

    gains = (1.0, 1.0)

    def _row(self, n: int) -> bytes:
        row = np.frombuffer(super()._row(n), "<i2").copy()
        row[:2] = np.round(row[:2] * np.array(self.gains))
        return row.tobytes()


@pytest.mark.parametrize(
    "gains",
    [
        (0.2, 0.2),
        (-1.0, 1.0),
        pytest.param((0.2, 1.0), marks=pytest.mark.slow),
        pytest.param((1.0, 0.2), marks=pytest.mark.slow),
    ],
)
def test_in_the_guard_it_costs_authority_keeps_the_range_from_widening_and_still_trips(
    gains: tuple[float, float],
) -> None:
    config = bench()
    node, core = Wired(config), GuardCore(config, CanCodec(), 7)
    node.clearance_um = node.target_um = 100.0
    node.mean_um, node.amplitude_um = place_um(config, 0.35, 100.0), 4.0
    now_ns, out, state, names = 0, [], None, list[str]()

    def go(milliseconds: int, commands: list[CommandRequest]) -> None:
        nonlocal now_ns, out, state
        for k in range(milliseconds):
            now_ns += MS
            node.hear(out)
            asked = commands if k == 0 else []
            decision = core.step(Cycle(0, now_ns, node.step(now_ns), None, asked, True, True, True))
            out, state = decision.frames_out, decision.state or state
            names.extend(event.name for event in decision.events)

    go(4000, [])
    assert state is not None
    before_um = state.clearance_high_um
    assert "disp_pair_position" not in names
    node.gains = gains
    go(5000, [])
    assert "disp_pair_position" in names
    assert state.clearance_high_um <= before_um
    assert {"disp_pair_position", "pair_implausible"} & {alarm.name for alarm in state.alarms}
    node.amplitude_um = 200.0
    go(2500, [])
    assert core.tripped


@pytest.mark.parametrize("obeys", [True, False])
@pytest.mark.parametrize(
    "gains",
    [
        (0.2, 0.2),
        (0.2, 1.0),
        pytest.param((0.5, 0.5), marks=pytest.mark.slow),
        pytest.param((1.0, 0.2), marks=pytest.mark.slow),
    ],
)
def test_a_lost_gain_never_widens_the_range_not_even_before_it_is_named(
    gains: tuple[float, float], obeys: bool
) -> None:
    b = Bench()
    b.node = node = Wired(b.config)
    node.step(b.now_ns)
    if obeys:
        b.armed()
    # stands at 50 um: what it would be driven to is the advice of 150 um within the range
    node.obeys = False
    b.advise_um = 150.0
    b.run(1.0 if obeys else 3.0)
    before_um = [d.state for d in b.run(0.3) if d.state][-1].clearance_high_um
    assert before_um < 100.0
    node.gains = gains
    after = [d.state for d in b.run(6.0) if d.state]
    assert all(s.clearance_high_um <= before_um + 1.0 for s in after)
    assert not after[-1].authority
    assert "disp_pair_position" in b.names()

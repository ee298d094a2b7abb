"""The whole device over wire schema 2, on the simulated clock: rigs with other channels and
readings than the bench's, with no line of code for them."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

import msgspec
import pytest

from firmware_py.brain.core import BrainCore
from firmware_py.brain.store import load_models
from firmware_py.config import Config
from firmware_py.gate.loop import metadata
from firmware_py.gate.metrics import render
from firmware_py.gate.recorder import Recorder
from firmware_py.gate.view import DeviceState, View
from firmware_py.guard.core import GuardCore
from firmware_py.machine import FastChannel, SlowChannel
from firmware_py.recording import Recording
from firmware_py.records import (
    CHANNELS,
    Block,
    CommandReply,
    Diagnosis,
    DriveCommand,
    DriveMode,
    DriveState,
    Event,
    GuardState,
    Mode,
    NodeFigures,
    PeerRecord,
    RawFrame,
    RigReading,
)
from firmware_py.replay.command import _config
from firmware_py.replay.decisions import DecisionReplay
from firmware_py.wire.codec import CanCodec
from firmware_py.wire.layout import WireLayout
from firmware_py.wire.link import codec_for
from sim_hil.closed_loop import ClosedLoop
from sim_hil.server import make_rig
from tests.wire.layouts import BENCH, rig

T = TypeVar("T")
SESSION = 0x51DE
UNIX_NS = 1_800_000_000_000_000_000


class Absent:
    """No brain."""

    def step(self, records: list[PeerRecord], now_ns: int) -> list[PeerRecord]:
        return []


class Flight:
    """A device at a rig; everything that crossed a border, by type."""

    def __init__(
        self,
        config: Config,
        node: Config | None = None,
        brain: Callable[[], object] = Absent,
        listener: Callable[[PeerRecord, int], object] = lambda record, now_ns: None,
    ) -> None:
        self.told: list[PeerRecord] = []
        self.rig = make_rig(node or config, "bench", 1, nominal=True)
        self.guard = GuardCore(config, codec_for(config), SESSION)
        self.loop = ClosedLoop(
            self.rig,
            self.guard,
            brain,
            [lambda record, now_ns: self.told.append(record), listener],
        )

    def run(self, milliseconds: int) -> None:
        for _ in range(milliseconds):
            self.loop.step()

    def arm(self) -> None:
        """Manual, armed, to 62 um."""
        self.run(2600)
        self.loop.command("mode", mode=Mode.MANUAL)
        self.run(50)
        self.loop.command("arm")
        self.run(50)
        self.loop.command("set_clearance", 62.0)
        self.run(800)

    def newest(self, kind: type[T]) -> T:
        return next(record for record in reversed(self.told) if isinstance(record, kind))

    @property
    def replies(self) -> list[CommandReply]:
        return [record for record in self.told if isinstance(record, CommandReply)]

    @property
    def events(self) -> list[str]:
        return [record.name for record in self.told if isinstance(record, Event)]


def on_serial(config: Config) -> Config:
    bus = msgspec.structs.replace(config.bus, link="serial", serial_port="/dev/ttyUSB0")
    return msgspec.structs.replace(config, bus=bus)


@pytest.mark.parametrize("link", [lambda config: config, on_serial], ids=["can", "serial"])
def test_the_device_arms_and_moves_the_bearing(link: Callable[[Config], Config]) -> None:
    flight = Flight(link(rig(8)))
    flight.arm()
    state = flight.newest(GuardState)
    assert [reply.reasons for reply in flight.replies] == [[], [], []]
    assert state.node_following
    assert state.alarms == []
    assert state.clearance_actual_um > 57.0
    assert state.run_permit
    assert not any(state.counters[name] for name in state.counters if name.startswith("reject"))
    assert flight.newest(RigReading).drive is not None


NINTH = FastChannel(
    "acc_pump", "m/s2", 0.01, -195.0, 195.0, kind="acceleration", words="Pump housing"
)
MORE = [
    SlowChannel("drive_torque", "torque", -5.0, 5.0, "Torque of the drive"),
    SlowChannel("coupling_temperature", "temperature"),
]


def nine() -> Config:
    base = rig(8)
    standard = [SlowChannel(name) for name in ("shaft_power", "oil_outlet")]
    standard += [SlowChannel(name) for name in ("clearance_actual", "pressure_actual")]
    return base.replaced(channel=[*base.machine.channel, NINTH], reading=[*standard, *MORE])


def test_a_ninth_channel_and_more_readings_go_through_the_whole_device(tmp_path: Path) -> None:
    config = nine()
    view = View(config)
    recorder = Recorder(tmp_path, "nine", metadata(config, {}), 1 << 26, lambda: UNIX_NS)

    def gate(record: PeerRecord, now_ns: int) -> None:
        view.step(record, now_ns)
        recorder.write(record, now_ns)

    flight = Flight(config, listener=gate)
    flight.arm()
    recorder.close()

    block = flight.newest(Block)
    assert (block.channels, block.channel_ok) == (9, 0x1FF)
    values = flight.newest(RigReading).values
    assert values["drive_torque"].value == pytest.approx(0.1, abs=0.1)
    state = flight.newest(GuardState)
    assert [alarm.name for alarm in state.alarms] == ["coupling_temperature_not_ok"]
    assert "absent" in state.alarms[0].text
    assert {"acc_pump_alert", "acc_pump_danger"} <= set(flight.guard.stages.protection.state.alarms)

    assert "acc_pump" in view.features.channel
    shown = view.instances.readings(view.reading)
    assert [row.words for row in shown[4:]] == ["Torque of the drive", "Temperature"]
    assert [row.ok for row in shown] == [True] * 5 + [False]
    assert view.instances.channels(view.features)[8].words == "Pump housing"
    device = DeviceState(
        site="x", rig="bench", instance="x", version="0", now_ns=1, unix_ns=1, rooms={},
        guard=view.guard, reading=view.reading, diagnosis=None, forecast=None, advice=None,
        brain=None, commission=None, normal="", alarms=[], recording="", counters={},
    )  # fmt: skip
    metrics = render(device, view.features, shown).decode()
    assert 'orbitd_channel_rms{channel="acc_pump"}' in metrics
    assert 'orbitd_reading_torque_Nm{reading="drive_torque"}' in metrics
    assert 'orbitd_reading_ok{reading="coupling_temperature"} 0.0' in metrics
    assert 'orbitd_reading_temperature_C{reading="coupling_temperature"}' not in metrics

    (path,) = tmp_path.glob("*.mcap")
    recording = Recording(path)
    recorded = _config(recording)
    assert WireLayout.of(recorded) == WireLayout.of(config)
    replay = DecisionReplay(recorded)
    for _ in replay.run(recording):
        pass
    assert replay.report.ok, replay.report.first_difference
    assert replay.report.cycles > 3000


def test_two_probes_are_enough_to_protect_and_command_but_not_to_diagnose() -> None:
    config = rig(2)
    models = load_models(config)
    flight = Flight(config, brain=lambda: BrainCore(config, models))
    flight.arm()
    block = flight.newest(Block)
    assert (block.channels, block.instants, block.channel_ok) == (2, 120, 0b11)
    assert flight.newest(GuardState).clearance_actual_um > 57.0
    verdict, _, missing = flight.newest(Diagnosis).verdict.partition(":")
    assert verdict == "no_channel"
    assert missing.split("+") == list(CHANNELS[2:])


def test_twelve_channels_at_10_kHz() -> None:
    flight = Flight(rig(12, 5, 10_000))
    flight.run(1500)
    block = flight.newest(Block)
    assert (block.channels, block.sample_period_us) == (12, 100)
    assert block.channel_ok & 0xFF == 0xFF
    stuck = [name for name in flight.events if name.endswith("_not_ok")]
    # Of kinds that the rig in software has not: their channels stand still.
    assert "extra_0_not_ok" in stuck
    assert "extra_1_not_ok" not in stuck


def test_a_node_with_another_list_of_channels_is_named_and_nothing_is_armed() -> None:
    config = nine()
    channels = list(config.machine.channel)
    channels[2], channels[3] = channels[3], channels[2]
    flight = Flight(config, node=config.replaced(channel=channels))
    flight.run(2600)
    flight.loop.command("mode", mode=Mode.MANUAL)
    flight.loop.command("arm")
    flight.run(50)
    assert not flight.replies[-1].accepted
    (reason,) = [text for text in flight.replies[-1].reasons if "layout" in text]
    assert "orbitd rig dbc" in reason
    counters = flight.newest(GuardState).counters
    assert counters["reject_layout"] > 0
    assert counters["frames_in"] == 0


@pytest.mark.parametrize(("device", "node"), [(1, 2), (2, 1)])
def test_a_node_of_the_other_schema_is_named(device: int, node: int) -> None:
    flight = Flight(rig(8, schema=device), node=rig(8, schema=node))
    flight.run(2600)
    flight.loop.command("mode", mode=Mode.MANUAL)
    flight.loop.command("arm")
    flight.run(50)
    assert any(f"node: schema = {node}" in text for text in flight.replies[-1].reasons)


def heard(frames: list[RawFrame], codec: CanCodec, kind: type) -> list[object]:
    return [m for m in map(codec.decode, frames) if isinstance(m, kind)]


def test_the_drive_follows_fresh_commands_and_goes_back_when_they_expire() -> None:
    config = rig(8)
    codec = CanCodec(WireLayout.of(config))
    node = make_rig(config, "bench", 1, nominal=True)
    now_ns, counter, frames = 1_000_000_000, 0, list[RawFrame]()
    states: list[DriveState] = []
    figures: list[object] = []
    echo = 0
    for cycle in range(2200):
        sent: list[RawFrame] = []
        if 500 <= cycle < 1500 and cycle % 50 == 0 and states:
            counter += 1
            echo = states[-1].tick_us
            command = DriveCommand(counter, 7, echo, 6300.0, 120.0, 500, 50)
            sent = [codec.encode(command)]
        now_ns += 1_000_000
        frames = node.step(now_ns, sent)
        states += heard(frames, codec, DriveState)
        figures += heard(frames, codec, NodeFigures)
    modes = [state.mode for state in states]
    assert DriveMode.FOLLOWING in modes
    assert (modes[0], modes[-1]) == (DriveMode.LOCAL, DriveMode.LOCAL)
    assert max(state.speed_rpm for state in states) == pytest.approx(6300.0, abs=120.0)
    assert states[-1].speed_setpoint_rpm == 6000.0
    assert states[-1].refused_stale == 0
    assert figures[0].drive_commandable
    assert figures[0].heartbeat_limit_ms == 3000


def test_a_stale_drive_command_is_refused_and_counted() -> None:
    config = rig(8)
    codec = CanCodec(WireLayout.of(config))
    node = make_rig(config, "bench", 1, nominal=True)
    states: list[DriveState] = []
    for cycle in range(600):
        sent = []
        if cycle == 300:
            stale = DriveCommand(
                1, 7, (states[-1].tick_us - 200_000) % (1 << 32), 7000.0, 120.0, 500, 50
            )
            sent = [codec.encode(stale)]
        states += heard(node.step(1_000_000_000 + cycle * 1_000_000, sent), codec, DriveState)
    assert states[-1].refused_stale == 1
    assert states[-1].mode == DriveMode.LOCAL


def test_figures_that_contradict_the_configuration_bar_arming() -> None:
    config = rig(8)
    drive = msgspec.structs.replace(config.drive, coast_down_on_lost_heartbeat=False)
    flight = Flight(msgspec.structs.replace(config, drive=drive), node=config)
    flight.run(2600)
    flight.loop.command("mode", mode=Mode.MANUAL)
    flight.loop.command("arm")
    flight.run(50)
    assert any("coast_down_on_lost_heartbeat" in text for text in flight.replies[-1].reasons)


def test_schema_1_is_the_default() -> None:
    assert BENCH.bus.schema == 1

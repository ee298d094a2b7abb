"""What the golden recordings hold: short flights of the whole device, every mode, alarm, trip and
command, both links.

A scenario is a script of what is done at which millisecond, on the simulated clock: rig, guard and
brain are the ones that ship, every frame crosses the encoder of its link.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Final, Literal

import msgspec

from firmware_py.brain.core import BrainCore
from firmware_py.brain.store import load_models
from firmware_py.config import Config
from firmware_py.guard.core import GuardCore
from firmware_py.records import Advice, Mode, PeerRecord, PlannedRamp, RawFrame
from firmware_py.wire.link import codec_for
from sim_hil.closed_loop import ClosedLoop, Listener, RigStage
from sim_hil.demo.setting import Setting, prepare
from sim_hil.hil.rig import Rig, node_limits

START_NS: Final = 5_000_000_000
SESSION: Final = 0x601DE
SEED: Final = 7

Wire = Callable[[int, list[RawFrame]], list[RawFrame]]
"""What happens to the frames from the rig in one cycle: (cycle, frames) to frames."""


class Flight:
    """One run of the whole device, and all that a script may do to it."""

    def __init__(
        self,
        setting: Setting,
        listener: Listener,
        wire: Wire | None,
        advice: Callable[[Advice], Advice],
    ) -> None:
        self.config: Config = setting.config
        codec = codec_for(self.config)
        self.rig = Rig(
            setting.rig,
            codec,
            node_limits(setting.rig, self.config),
            SEED,
            build=setting.build,
            rate_hz=self.config.sampling.rate_hz,
        )
        self._models = load_models(self.config)
        self._advice = advice
        stage: RigStage = _Meddled(self.rig, wire) if wire else self.rig
        self.loop = ClosedLoop(
            stage, GuardCore(self.config, codec, SESSION), self._brain, [listener], START_NS
        )

    def _brain(self) -> _Brain:
        return _Brain(BrainCore(self.config, self._models), self._advice)

    def mode(self, mode: Mode) -> None:
        self.loop.command("mode", mode=mode)

    def command(self, verb: str, value: float | None = None) -> None:
        self.loop.command(verb, value)

    def announce(self, start_s: float, end_s: float, speed_rpm: float, load_N: float) -> None:
        ramp = PlannedRamp(start_s, end_s, speed_rpm, load_N)
        self.loop.command("announce", ramp=ramp)

    def operate(self, speed_rpm: float, load_N: float, ramp_s: float) -> None:
        self.rig.set_operating(speed_rpm, load_N, ramp_s)


class _Brain:
    """The brain, with what a wrong one would say instead."""

    def __init__(self, core: BrainCore, advice: Callable[[Advice], Advice]) -> None:
        self._core, self._advice = core, advice

    def step(self, records: list[PeerRecord], now_ns: int) -> list[PeerRecord]:
        said = self._core.step(records, now_ns)
        return [self._advice(record) if isinstance(record, Advice) else record for record in said]


class _Meddled:
    """A rig behind a bad wire."""

    def __init__(self, rig: Rig, wire: Wire) -> None:
        self._rig, self._wire, self._cycle = rig, wire, 0

    def step(self, now_ns: int, frames_in: list[RawFrame]) -> list[RawFrame]:
        self._cycle += 1
        return self._wire(self._cycle, self._rig.step(now_ns, frames_in))


Action = Callable[[Flight], None]


@dataclass(frozen=True)
class Scenario:
    """A script: ``at`` holds what is done, by millisecond; ``must`` names events without which it
    shows nothing."""

    name: str
    what: str
    seconds: float
    at: Sequence[tuple[int, Action]]
    must: tuple[str, ...] = ()
    link: Literal["can", "serial"] = "can"
    wire: Wire | None = None
    advice: Callable[[Advice], Advice] = field(default=lambda advice: advice)

    def setting(self) -> Setting:
        """Configuration and build."""
        port = {"serial_port": "/dev/golden"} if self.link == "serial" else {}
        return prepare("bench", SEED).on(link=self.link, **port)

    def fly(self, listener: Listener) -> None:
        """Run it; ``listener`` gets every record that crosses a room's border."""
        flight = Flight(self.setting(), listener, self.wire, self.advice)
        actions: dict[int, list[Action]] = {}
        for millisecond, action in self.at:
            actions.setdefault(millisecond, []).append(action)
        for millisecond in range(round(1000 * self.seconds)):
            for action in actions.get(millisecond, ()):
                action(flight)
            flight.loop.step()


ARMED_AUTO: Final[list[tuple[int, Action]]] = [
    (2000, lambda f: f.mode(Mode.AUTO)),
    (2100, lambda f: f.command("arm")),
]
ARMED_MANUAL: Final[list[tuple[int, Action]]] = [
    (2000, lambda f: f.mode(Mode.MANUAL)),
    (2100, lambda f: f.command("arm")),
]


def _inject(name: str, severity: float) -> Action:
    return lambda f: f.rig.inject(name, severity)


def _clear(flight: Flight) -> None:
    flight.rig.clear()


def _operate(speed_rpm: float, load_N: float, ramp_s: float) -> Action:
    return lambda f: f.operate(speed_rpm, load_N, ramp_s)


def _do(verb: str, value: float | None = None) -> Action:
    return lambda f: f.command(verb, value)


MANUAL_COMMANDS: Final[list[tuple[int, Action]]] = [
    (500, _do("arm")),
    (700, _do("set_clearance", 70.0)),
    *ARMED_MANUAL,
    (3000, _do("set_clearance", 70.0)),
    (4000, _do("set_clearance", 5.0)),
    (4200, _do("set_clearance", math.nan)),
    (4500, _do("set_pressure", 3.0)),
    (4700, _do("set_pressure", 99.0)),
    (5000, lambda f: f.announce(3.0, 4.0, 9000.0, 150.0)),
    (5100, lambda f: f.announce(0.1, 0.2, 90000.0, 1.0)),
    (5300, _do("no_such_verb")),
    (8000, _operate(9000.0, 150.0, 1.0)),
    (8500, _do("disarm")),
    (8700, _do("set_clearance", 80.0)),
    (9000, _do("arm")),
    (9500, lambda f: f.mode(Mode.MONITOR)),
    (9600, _do("reset")),
    (9700, _do("disarm")),
]


def noisy(cycle: int, frames: list[RawFrame]) -> list[RawFrame]:
    """From 4.5 s on: frames lost, doubled, out of order, cut, with a flipped bit; 7.0 to 7.4 s:
    nothing at all."""
    if cycle < 4500:
        return frames
    if 7000 <= cycle < 7400:
        return []
    out: list[RawFrame] = []
    for number, frame in enumerate(frames):
        match (cycle + number) % 97:
            case 3:
                continue
            case 11:
                out += [frame, frame]
            case 23:
                out.insert(0, frame)
            case 41:
                out.append(msgspec.structs.replace(frame, data=frame.data[: len(frame.data) // 2]))
            case 59:
                out.append(
                    msgspec.structs.replace(frame, data=bytes([frame.data[0] ^ 1]) + frame.data[1:])
                )
            case 71:
                out.append(
                    msgspec.structs.replace(frame, arrival_ns=frame.arrival_ns + 3_600_000_000_000)
                )
            case _:
                out.append(frame)
    return out


class Playback:
    """Frames of the fourth second come again in the seventh: a log is played back onto the bus."""

    def __init__(self) -> None:
        self._kept: list[RawFrame] = []

    def __call__(self, cycle: int, frames: list[RawFrame]) -> list[RawFrame]:
        if cycle == 1:
            self._kept.clear()
        if 3000 <= cycle < 4000:
            self._kept += frames
        if not 6000 <= cycle < 6500:
            return frames
        again, self._kept = self._kept[:4], self._kept[4:]
        now_ns = frames[-1].arrival_ns if frames else 0
        return [*frames, *(msgspec.structs.replace(frame, arrival_ns=now_ns) for frame in again)]


class SecondSender:
    """From 5 s to 7 s a second rig, of another build, sends the same streams on the same bus."""

    def __init__(self) -> None:
        self._rig: Rig | None = None

    def __call__(self, cycle: int, frames: list[RawFrame]) -> list[RawFrame]:
        if cycle == 1:
            setting = prepare("bench", SEED + 1)
            self._rig = Rig(
                setting.rig,
                codec_for(setting.config),
                node_limits(setting.rig, setting.config),
                SEED + 1,
                build=setting.build,
                rate_hz=setting.config.sampling.rate_hz,
            )
        if not 4900 <= cycle < 7000 or self._rig is None:
            return frames
        others = self._rig.step(START_NS + (cycle + 1) * 1_000_000, [])
        return [*frames, *others] if cycle >= 5000 else frames


def _silence(cycle: int, frames: list[RawFrame]) -> list[RawFrame]:
    """Nothing from the node from 5 s to 9.5 s."""
    return [] if 5000 <= cycle < 9500 else frames


def _wrong(advice: Advice) -> Advice:
    """A model gone wild: out of range, not finite, from the future, too old, long-lived, in
    turn."""
    change = msgspec.structs.replace
    match advice.seq // 5 % 8:
        case 2:
            return change(advice, clearance_um=1e9)
        case 3:
            return change(advice, clearance_um=math.nan)
        case 4:
            return change(advice, t_ns=advice.t_ns + 10**12, t_acq_ns=advice.t_acq_ns + 10**12)
        case 5:
            return change(advice, t_acq_ns=advice.t_acq_ns - 10**9)
        case 6:
            return change(advice, lifetime_ns=2**62)
        case 7:
            return change(advice, clearance_um=40.0 if advice.seq % 2 else 160.0)
    return advice


FAULTS: Final[list[tuple[int, Action]]] = [
    (4500, _inject("sensor_stuck:disp_x", 1.0)),
    (5500, _clear),
    (6000, _inject("sensor_dropout:acc_motor", 1.0)),
    (7500, _clear),
    (8000, _inject("sensor_offset:disp_y", 1.0)),
    (9000, _clear),
    (9500, _inject("sensor_hum:disp_x", 1.0)),
    (10500, _clear),
    (10700, _inject("sensor_gain:disp_y", 1.0)),
]
DANGER: Final[list[tuple[int, Action]]] = [
    *ARMED_AUTO,
    (4500, _inject("unbalance", 100.0)),
    (8500, _do("reset")),
    (9000, _clear),
    (11500, _do("reset")),
    (12000, _do("arm")),
]
AUTO: Final[list[tuple[int, Action]]] = [
    *ARMED_AUTO,
    (4000, _operate(9000.0, 200.0, 2.0)),
    (8000, lambda f: f.loop.kill_brain()),
    (9000, lambda f: f.loop.start_brain()),
    (11000, _do("disarm")),
]

SCENARIOS: Final = (
    Scenario(
        "monitor",
        "healthy in mode monitor, a slow change of speed and load",
        10.0,
        [(4000, _operate(4500.0, 60.0, 3.0))],
    ),
    Scenario(
        "auto",
        "armed in mode auto through a ramp; the brain is killed and comes back; disarmed",
        12.0,
        AUTO,
        ("command",),
    ),
    Scenario(
        "manual",
        "every command, accepted and refused, with all reasons",
        10.0,
        MANUAL_COMMANDS,
        ("command",),
    ),
    Scenario(
        "unbalance",
        "armed; a large unbalance to danger and trip; reset refused, then accepted",
        13.0,
        DANGER,
        ("tripped",),
    ),
    Scenario(
        "bolts",
        "armed; a bolt of the pedestal, then of the motor works loose",
        11.0,
        [
            *ARMED_AUTO,
            (4500, _inject("pedestal_bolt", 0.0)),
            (7000, _clear),
            (7200, _inject("motor_bolt", 0.0)),
        ],
    ),
    Scenario(
        "whirl",
        "a light load at high speed, where the shaft may whirl",
        11.0,
        [*ARMED_AUTO, (3000, _operate(12000.0, 30.0, 3.5))],
    ),
    Scenario(
        "run_down",
        "the drive runs down under load and comes back",
        12.0,
        [
            *ARMED_AUTO,
            (3000, _operate(1200.0, 300.0, 3.0)),
            (7000, _operate(0.0, 100.0, 2.0)),
            (10000, _operate(6000.0, 100.0, 1.5)),
        ],
    ),
    Scenario(
        "overspeed",
        "the drive runs away beyond its declared speed",
        11.0,
        [*ARMED_AUTO, (3000, _operate(12000.0, 100.0, 2.0)), (6000, _operate(18000.0, 100.0, 3.0))],
        ("speed_undeclared",),
    ),
    Scenario(
        "oil",
        "armed; the oil starves, then its pressure is lost",
        12.0,
        [
            *ARMED_AUTO,
            (4500, _inject("starvation", 1.0)),
            (7000, _clear),
            (7500, _inject("pressure_loss", 1.0)),
        ],
    ),
    Scenario(
        "sensors",
        "armed; a stuck, an intermittent, a shifted, a humming and a wrong sensor",
        12.0,
        [*ARMED_AUTO, *FAULTS],
    ),
    Scenario(
        "bus",
        "armed; frames lost, doubled, out of order, cut, flipped, misdated; a hole of 0.4 s",
        10.0,
        ARMED_AUTO,
        wire=noisy,
    ),
    Scenario(
        "playback",
        "armed; an earlier second of the bus is played back onto it",
        9.0,
        ARMED_AUTO,
        wire=Playback(),
    ),
    Scenario(
        "second_sender",
        "armed; another rig sends on the same bus for 2 s",
        11.0,
        ARMED_AUTO,
        wire=SecondSender(),
    ),
    Scenario("silence", "armed; the node falls silent for 4.5 s", 11.0, ARMED_AUTO, wire=_silence),
    Scenario("advice", "armed; a model gone wild advises", 11.0, ARMED_AUTO, advice=_wrong),
    Scenario(
        "serial_auto", "the flight of `auto` over MAVLink", 12.0, AUTO, ("command",), "serial"
    ),
    Scenario(
        "serial_manual",
        "the commands of `manual` over MAVLink",
        10.0,
        MANUAL_COMMANDS,
        ("command",),
        "serial",
    ),
    Scenario(
        "serial_unbalance",
        "the trip of `unbalance` over MAVLink",
        13.0,
        DANGER,
        ("tripped",),
        "serial",
    ),
    Scenario(
        "serial_bus",
        "the bad wire of `bus` over MAVLink",
        10.0,
        ARMED_AUTO,
        link="serial",
        wire=noisy,
    ),
)

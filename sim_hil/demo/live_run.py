"""The demo in real time: rig, guard, brain and gate as processes, as on a machine."""

from __future__ import annotations

import contextlib
import signal
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import msgspec

from firmware_py.commands.run import programs
from firmware_py.config.written import rig_texts, write_rig
from firmware_py.errors import OrbitdError
from firmware_py.gate import keys
from firmware_py.gate.client import Client, NoAnswerError
from firmware_py.gate.session import SessionError
from firmware_py.machine.folder import SIMULATION
from firmware_py.records import (
    Advice,
    Diagnosis,
    Event,
    Forecast,
    GuardState,
    PeerRecord,
    RigReading,
)
from firmware_py.supervise import Program, Supervisor
from firmware_py.wire import pty_cable
from sim_hil.console import ask
from sim_hil.demo.live import Quiet, beat_text
from sim_hil.demo.observer import StoryObserver, StoryTruth
from sim_hil.demo.setting import Setting
from sim_hil.demo.story import Beat, Story
from sim_hil.plant.truth import RigTruth

BRAIN_AWAY_S: Final = 3.0
"""How long a killed brain stays away, so that a person sees the guard without it."""

START_WITHIN_S: Final = 90.0
"""The first start compiles the rig."""

POLL_S: Final = 0.02
TRUTH_EVERY_S: Final = 0.5

SUBSCRIPTIONS: Final[dict[str, type[PeerRecord]]] = {
    "sd/state": GuardState,
    "da/reading": RigReading,
    "ha/diagnosis": Diagnosis,
    "pa/forecast": Forecast,
    "ag/advice": Advice,
    "event/**": Event,
}


class StartError(OrbitdError):
    """The processes did not come up; the text names the one that is missing and its log."""


@dataclass
class LiveRun:
    """What a run in real time leaves behind."""

    observer: StoryObserver
    counters: dict[str, int]
    lag_ms_max: float
    brain_back_s: float | None
    first_command_s: float
    recording: str


def _texts(setting: Setting) -> dict[str, str]:
    """The files of the rig folder that the processes read."""
    more = {SIMULATION: setting.simulation} if setting.simulation else {}
    return rig_texts(setting.config) | more


class DemoProcesses:
    """The processes of one demo and the two ways to talk to them.

    Everything lives in one folder: configuration, sockets, logs, recording.
    """

    def __init__(self, setting: Setting, seed: int, folder: Path) -> None:
        self.folder = folder
        self.setting = setting
        self.supervisor = Supervisor()
        rig = folder / "rig"
        write_rig(_texts(setting), rig)
        options = ["--rig", str(rig), "--runtime-dir", str(folder)]
        device = setting.config.device
        self._prefix = keys.prefix(device.site, device.rig)
        if setting.config.bus.link == "serial":
            self._start("cable", ("-m", "firmware_py.wire.pty_cable", str(folder)))
            rig = folder / "rig_on_cable"
            on_cable = setting.on(serial_port=str(pty_cable.ends(folder)[1]))
            write_rig(_texts(on_cable), rig)
        rig_options = [
            "--rig",
            str(rig),
            "--runtime-dir",
            str(folder),
            "--seed",
            str(seed),
        ]
        self._start("hil", ("-m", "firmware_py", "hil", *rig_options))
        for program in programs(options, folder / "log"):
            self.supervisor.start(_shaped(program, folder))

    def _start(self, name: str, arguments: tuple[str, ...]) -> None:
        self.supervisor.start(
            Program(name, (sys.executable, *arguments), self.folder / "log" / f"{name}.log")
        )

    def connect(self) -> Client:
        """A client of the gate, as soon as samples flow through guard and gate.

        Raises
        ------
        StartError
            Something did not come up within :data:`START_WITHIN_S`.
        """
        give_up = time.monotonic() + START_WITHIN_S
        missing = "gate"
        while time.monotonic() < give_up:
            with contextlib.suppress(SessionError, NoAnswerError):
                client = Client(self.folder, self._prefix)
                state = client.status()
                missing = "hil" if state.guard else "guard"
                if state.guard and state.guard.speed_rad_s > 0 and all(state.rooms.values()):
                    return client
                missing = missing if not state.guard or state.guard.speed_rad_s == 0 else "brain"
                client.close()
            time.sleep(0.1)
        log = self.folder / "log" / f"{missing}.log"
        tail = log.read_text()[-400:].strip() if log.exists() else "no log"
        raise StartError(
            f"{missing} did not come up within {START_WITHIN_S:.0f} s; its log ends: {tail}"
        )

    def rig(self, **request: Any) -> dict[str, Any]:
        """One request to the rig's console."""
        return ask(self.folder, request)

    def stop(self) -> None:
        """End all processes."""
        self.supervisor.stop()


@contextlib.contextmanager
def open_stage(setting: Setting, seed: int) -> Iterator[DemoProcesses]:
    """Processes on a bus (or cable) of their own, ended and removed afterwards."""
    signal.signal(
        signal.SIGTERM, signal.default_int_handler
    )  # a demo that is told to stop cleans up too
    with tempfile.TemporaryDirectory(prefix="orbitd-demo-") as name:
        folder = Path(name)
        if setting.config.bus.link == "serial":
            shaped = setting.on(serial_port=str(pty_cable.ends(folder)[0]))
        else:
            shaped = setting.on(channel=folder.name)
        stage = DemoProcesses(shaped, seed, folder)
        try:
            yield stage
        finally:
            stage.stop()


def play(
    stage: DemoProcesses, story: Story, screen: Quiet, observer: StoryObserver, started_s: float
) -> LiveRun:
    """Play ``story``; ``started_s`` is when the command was typed (for the time to the first
    command)."""
    client = stage.connect()
    observer.started_ns = time.monotonic_ns()
    performer = _Performer(stage, client, screen, observer)
    first_command_s = time.monotonic() - started_s
    subscriptions = {kind: client.subscribe(name) for name, kind in SUBSCRIPTIONS.items()}
    beats = list(story.beats)
    truth_due_s = 0.0
    with screen:
        while (t_s := observer.story_s(time.monotonic_ns())) < story.seconds:
            while beats and beats[0].t_s <= t_s:
                performer.perform(beats.pop(0))
            for died in stage.supervisor.poll(time.monotonic()):
                screen.say(
                    f"{t_s:6.1f} s     {died.name} ended ({died.code}); it is started again in a "
                    f"moment"
                )
            _listen(subscriptions, observer)
            performer.watch_brain()
            if t_s >= truth_due_s:
                truth_due_s = t_s + TRUTH_EVERY_S
                performer.read_truth()
            screen.update(t_s)
            time.sleep(POLL_S)
    performer.read_truth()
    lag_ms = float(stage.rig(verb="status")["lag_ms_max"])
    state = client.status()
    client.close()
    counters = state.guard.counters if state.guard else {}
    return LiveRun(
        observer, counters, lag_ms, performer.brain_back_s, first_command_s, state.recording
    )


class _Performer:
    """Does what the beats say, through the rig's console and the device's own commands."""

    def __init__(
        self, stage: DemoProcesses, client: Client, screen: Quiet, observer: StoryObserver
    ) -> None:
        self._stage, self._client, self._screen, self._observer = stage, client, screen, observer
        self._truth_ns = 0
        self._killed_s: float | None = None
        self.brain_back_s: float | None = None

    def perform(self, beat: Beat) -> None:
        """One beat, now."""
        now_ns = time.monotonic_ns()
        self._observer.on_beat(beat, now_ns)
        self._screen.say(f"{self._observer.story_s(now_ns):6.1f} s     {beat_text(beat)}")
        match beat.verb:
            case "operating":
                self._stage.rig(
                    verb="operating",
                    speed_rpm=beat.speed_rpm,
                    load_N=beat.load_N,
                    ramp_s=beat.ramp_s,
                )
            case "inject":
                self._stage.rig(verb="inject", fault=beat.fault, severity=beat.severity)
            case "clear":
                self._stage.rig(verb="clear")
            case "arm":
                for verb, value in (("mode", "auto"), ("arm", None)):
                    reply = self._client.ask(verb, value)
                    for reason in reply.reasons:
                        self._screen.say(f"             {verb} refused: {reason}", "yellow")
            case "kill_brain":
                self._observer.advice = None
                self._killed_s = self._observer.story_s(now_ns)
                self._stage.supervisor.kill("brain")

    def watch_brain(self) -> None:
        """Notice the first word of the new brain."""
        if self._killed_s is not None and self._observer.advice is not None:
            back_s = self._observer.story_s(time.monotonic_ns()) - self._killed_s
            if back_s > 1.0:
                self.brain_back_s, self._killed_s = round(back_s, 2), None
                self._screen.say("             the brain is back and starts anew")
            self._observer.advice = None

    def read_truth(self) -> None:
        """What the rig has noted since the last time."""
        for entry in self._stage.rig(
            verb="truth", after_ns=max(self._truth_ns, self._observer.started_ns)
        )["truth"]:
            record = msgspec.convert(entry, RigTruth)
            self._truth_ns = record.t_ns
            self._observer.truth.append(StoryTruth.of(record, self._observer.story_s(record.t_ns)))


def _listen(subscriptions: dict[type[PeerRecord], Any], observer: StoryObserver) -> None:
    """Take in everything that the gate has published."""
    for kind, subscriber in subscriptions.items():
        while (sample := subscriber.try_recv()) is not None:
            record: PeerRecord = msgspec.json.decode(sample.payload.to_bytes(), type=kind)
            observer.on_record(record, time.monotonic_ns())


def _shaped(program: Program, folder: Path) -> Program:
    """The brain stays away for a while after its kill; the gate records into the demo's folder."""
    if program.name == "brain":
        return Program(program.name, program.argv, program.log, restart_after_s=BRAIN_AWAY_S)
    if program.name == "gate":
        return Program(
            program.name, (*program.argv, "--record", str(folder / "recording")), program.log
        )
    return program

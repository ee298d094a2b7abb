"""Who is killed or stopped, and what the machine and its protection do meanwhile: real processes, a
real bus.

``python tests/faults/kill_matrix.py --repeats 30 --out kills.jsonl`` runs ``orbitd hil`` and
``orbitd run`` and, for every victim (guard, brain, gate, rig) and signal (SIGKILL; SIGSTOP, later
SIGCONT), measures what the bus shows.  A trial takes some 15 s; a run that was interrupted goes on
where it ended.  Results: one line of JSON per trial in the file, a table at the end.

What is read where: the target from NODE_STATE (every 50 ms, so a reaction is seen up to 50 ms late
and the bars allow for that), the drive from SAMPLES, alarms from the guard's events.  An empty loop
runs beside all this: where it stood still, the host did, and the table says for how long.
"""

from __future__ import annotations

import argparse
import contextlib
import itertools
import json
import os
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Final

import msgspec

from firmware_py.config.written import rig_texts, write_rig
from firmware_py.gate import keys
from firmware_py.gate.client import Client, NoAnswerError
from firmware_py.gate.session import SessionError
from firmware_py.recording import TOPICS, Recording, RecordingError
from firmware_py.records import (
    ArmState,
    Command,
    DeviceHeartbeat,
    Event,
    GuardState,
    Mode,
    NodeMode,
    NodeState,
    SampleFrame,
)
from firmware_py.supervise import GOOD_START_S, die_with_parent
from firmware_py.wire.layout_fields import SampleFlag
from firmware_py.wire.link import codec_for, open_link
from sim_hil.console import ConsoleError, ask
from sim_hil.demo.setting import Setting, prepare

VICTIMS: Final = ("guard", "brain", "gate", "rig")
SIGNALS: Final = ("KILL", "STOP")
MODES: Final = {"guard": "manual", "brain": "auto", "gate": "auto", "rig": "manual"}
"""Where the brain has no part in what is measured, a person sets the target: that is ready
sooner."""

AWAY_UM: Final = 65.0
STOPPED_S: Final = 1.5
"""A stopped process goes on after this time: less than the drive waits for a heartbeat (3 s)."""

TRIALS_PER_DEVICE: Final = 10
WATCH_S: Final = 4.0
"""Longer than the drive's heartbeat limit: a machine that coasts because of the signal does so in
this time."""

READY_WITHIN_S: Final = 120.0
REPORT_MS: Final = 50
NODE_CYCLE_MS: Final = 10
ALARM_MS: Final = 1000
"""Samples stop being fresh after 20 ms; alarm, state and its way through the gate add the rest."""

CYCLE_MS: Final = 130
"""One command period, one node cycle, one time to live: what lies between the end of advice and the
retreat value."""


class TrialError(Exception):
    """The device did not get ready for a trial; the text says what was missing."""


@dataclass
class Trial:
    """One signal and what came of it; times in ms after the signal, None: not seen."""

    victim: str
    signal: str
    reaction_ms: float | None
    bar_ms: float | None
    ok: bool
    coasted: bool
    back_ms: float | None
    permit_gap_ms: float | None
    host_stall_ms: float
    note: str = ""


@dataclass
class Seen:
    """What the bus has shown, with host times in ns; filled by :class:`Ear`."""

    states: list[tuple[int, NodeState]] = field(default_factory=list)
    beats: list[tuple[int, DeviceHeartbeat]] = field(default_factory=list)
    commands: list[tuple[int, Command]] = field(default_factory=list)
    samples_ns: int = 0
    coasting_ns: list[int] = field(default_factory=list)


class Ear(threading.Thread):
    """Listens on the bus as a third station."""

    def __init__(self, setting: Setting) -> None:
        super().__init__(daemon=True)
        self.seen = Seen()
        self._codec = codec_for(setting.config)
        self._link = open_link(setting.config, "rig")
        self._stop_asked = threading.Event()

    def run(self) -> None:
        while not self._stop_asked.is_set():
            now_ns = time.monotonic_ns()
            for frame in self._link.receive(now_ns):
                self._take(frame.arrival_ns, self._codec.decode(frame))
            time.sleep(0.002)
        self._link.close()

    def _take(self, t_ns: int, message: object) -> None:
        seen = self.seen
        if isinstance(message, SampleFrame):
            seen.samples_ns = t_ns
            if message.flags & SampleFlag.COASTING:
                seen.coasting_ns.append(t_ns)
        elif isinstance(message, NodeState):
            seen.states.append((t_ns, message))
        elif isinstance(message, DeviceHeartbeat):
            seen.beats.append((t_ns, message))
        elif isinstance(message, Command):
            seen.commands.append((t_ns, message))

    def forget(self) -> None:
        """Begin anew."""
        self.seen = Seen()

    def stop(self) -> None:
        """Leave the bus."""
        self._stop_asked.set()
        self.join(2.0)


class Stalls(threading.Thread):
    """Reads what the empty loop (:func:`probe`) prints: when it stood still, and for how long."""

    def __init__(self) -> None:
        super().__init__(daemon=True)
        self._process = subprocess.Popen(
            [sys.executable, __file__, "--probe"],
            stdout=subprocess.PIPE,
            text=True,
            preexec_fn=die_with_parent,
        )
        self._found: list[tuple[int, float]] = []

    def run(self) -> None:
        for line in self._process.stdout or ():
            with contextlib.suppress(ValueError):  # the last line, cut off at the end
                t_ns, late_ms = line.split()
                self._found.append((int(t_ns), float(late_ms)))

    def worst_ms(self, from_ns: int, to_ns: int) -> float:
        """The longest stall between two host times."""
        return max(
            (late for t_ns, late in list(self._found) if from_ns <= t_ns <= to_ns), default=0.0
        )

    def stop(self) -> None:
        """End the empty loop."""
        self._process.kill()
        self._process.wait()


def probe() -> None:
    """An empty loop of 1 ms: prints host time and lateness of every stall over 5 ms."""
    due_ns = time.monotonic_ns()
    while True:
        due_ns += 1_000_000
        time.sleep(max(0, due_ns - time.monotonic_ns()) * 1e-9)
        late_ns = time.monotonic_ns() - due_ns
        if late_ns > 5_000_000:
            print(time.monotonic_ns(), round(late_ns * 1e-6, 1), flush=True)
            due_ns += late_ns


class Device:
    """One device and one rig in a folder of their own, as a person starts them."""

    def __init__(self, folder: Path, seed: int) -> None:
        shaped = prepare("bench", seed).on(channel=folder.name)
        recorder = msgspec.structs.replace(
            shaped.config.recorder, directory=str(folder / "recording")
        )
        self.setting = Setting(shaped.config.replaced(recorder=recorder), shaped.rig, shaped.build)
        self.folder = folder
        device = self.setting.config.device
        self._prefix = keys.prefix(device.site, device.rig)
        write_rig(rig_texts(self.setting.config), folder / "rig")
        self._options = ["--rig", str(folder / "rig"), "--runtime-dir", str(folder)]
        self._seed = seed
        self.rig = self._start("hil", "--seed", str(seed))
        self.run = self._start("run")
        self.ear = Ear(self.setting)
        self.ear.start()
        self.client: Client | None = None

    def _start(self, command: str, *more: str) -> subprocess.Popen[bytes]:
        with (self.folder / f"{command}.txt").open("ab") as log:
            return subprocess.Popen(
                [sys.executable, "-m", "firmware_py", command, *self._options, *more],
                stdout=log,
                stderr=log,
                preexec_fn=die_with_parent,
            )

    def pid(self, victim: str) -> int:
        """Process id of the rig, or of a child of `orbitd run`."""
        if victim == "rig":
            return self.rig.pid
        children = Path(f"/proc/{self.run.pid}/task/{self.run.pid}/children").read_text().split()
        for child in children:
            with contextlib.suppress(OSError):
                words = Path(f"/proc/{child}/cmdline").read_bytes().split(b"\0")
                if victim.encode() in words[:5]:
                    return int(child)
        raise TrialError(f"no process {victim}; see {self.folder}")

    def ensure_rig(self) -> None:
        """Nobody supervises the rig: start a killed one again."""
        if self.rig.poll() is not None:
            self.rig = self._start("hil", "--seed", str(self._seed))

    def state(self) -> GuardState | None:
        """What the guard says of itself, through the gate; None while one of them is away."""
        try:
            if self.client is None:
                self.client = Client(self.folder, self._prefix)
            found = self.client.status()
        except (SessionError, NoAnswerError):
            self.forget_client()
            return None
        return found.guard if all(found.rooms.values()) else None

    def forget_client(self) -> None:
        """The gate went away."""
        if self.client is not None:
            with contextlib.suppress(
                Exception
            ):  # a session whose other end died may end in any way
                self.client.close()
            self.client = None

    def ready(self, mode: str) -> None:
        """Running, armed in ``mode`` (auto: authority held), and the node at a target that is not
        the retreat value.

        Raises
        ------
        TrialError
            Not within :data:`READY_WITHIN_S`; the text says what the guard still misses.
        """
        end_s, missing = time.monotonic() + READY_WITHIN_S, "the gate"
        while time.monotonic() < end_s:
            self.ensure_rig()
            state = self.state()
            if state is not None:
                missing = self._next_step(state, mode)
                if not missing:
                    return
            time.sleep(0.2)
        logs = "; ".join(
            f"{path.name}: {path.read_text()[-200:].strip()}"
            for path in self.folder.glob("log/*.log")
        )
        raise TrialError(f"not ready within {READY_WITHIN_S:g} s: {missing} ({logs})")

    def _next_step(self, state: GuardState, mode: str) -> str:
        """Do what a person would do next; what is still missing, empty when nothing is."""
        with contextlib.suppress(ConsoleError, OSError):
            if ask(self.folder, {"verb": "status"})["coasting"] and state.run_permit:
                ask(self.folder, {"verb": "start"})
                return "the drive was started again"
        if state.arm_state == ArmState.TRIPPED and self.client:
            self.client.ask("reset")
            return "tripped"
        if (
            state.arm_state not in (ArmState.ARMED, ArmState.RECOVERY)
            or mode != Mode(state.mode).name.lower()
        ) and self.client:
            self.client.ask("mode", mode)
            reply = self.client.ask("arm")
            if mode == "manual":
                self.client.ask("set_clearance", AWAY_UM)
            return f"armed: {'; '.join(reply.reasons)}"
        if mode == "auto" and not state.authority:
            return (
                f"authority ({ArmState(state.arm_state).name}): "
                f"{'; '.join(state.authority_reasons)}"
            )
        if not state.run_permit:
            return f"run permit: {'; '.join(state.permit_reasons)}"
        safe_um = self.setting.config.machine.actuator.safe_radial_clearance_um
        states = self.ear.seen.states
        if not states or abs(states[-1][1].target_clearance_um - safe_um) < 1.0:
            return f"a target away from {safe_um:g} um"
        return "" if states[-1][1].mode == NodeMode.FOLLOWING else "the node does not follow"

    def stop(self) -> None:
        """End everything."""
        self.forget_client()
        self.ear.stop()
        for process in (self.run, self.rig):
            process.send_signal(signal.SIGCONT)
            process.terminate()
        for process in (self.run, self.rig):
            try:
                process.wait(8)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()


# ------------------------------------------------------------------ one trial


def trial(device: Device, victim: str, kind: str, stalls: Stalls) -> Trial:
    """Send the signal, watch, and judge."""
    device.ready(MODES[victim])
    pid = device.pid(victim)
    _settle(pid)
    subscriber = device.client.subscribe("event/**") if device.client else None
    device.ear.forget()
    _until(lambda: bool(device.ear.seen.states and device.ear.seen.beats), 2.0)
    before = device.ear.seen.states[-1][1] if device.ear.seen.states else None
    session = device.ear.seen.beats[-1][1].session if device.ear.seen.beats else 0
    sent_ns = time.monotonic_ns()
    os.kill(pid, signal.SIGKILL if kind == "KILL" else signal.SIGSTOP)
    if kind == "STOP":
        time.sleep(STOPPED_S)
        os.kill(pid, signal.SIGCONT)
    time.sleep(max(0.0, WATCH_S - (time.monotonic_ns() - sent_ns) * 1e-9))
    seen = device.ear.seen
    coasted = any(t_ns > sent_ns for t_ns in seen.coasting_ns)
    stall_ms = stalls.worst_ms(sent_ns - 50_000_000, time.monotonic_ns())
    gap_ms = _permit_gap_ms(seen, sent_ns)
    back_ms = _back_ms(seen, sent_ns, session) if (victim, kind) == ("guard", "KILL") else None
    base = (coasted, back_ms, gap_ms, stall_ms)
    if victim == "rig":
        reaction = _alarm_ms(subscriber, sent_ns)
        return Trial(
            victim, kind, reaction, ALARM_MS, reaction is not None and reaction <= ALARM_MS, *base
        )
    if victim == "gate":
        moved = [
            s
            for t_ns, s in seen.states
            if t_ns > sent_ns
            and before is not None
            and (s.mode != before.mode or s.session != before.session)
        ]
        retreated = _retreat_ms(device, seen, sent_ns) is not None
        note = "the target went to the retreat value" if retreated else ""
        return Trial(
            victim, kind, None, None, not moved and not retreated and not coasted, *base, note
        )
    reaction = _retreat_ms(device, seen, sent_ns)
    bar_ms = float(_bar_ms(device, victim, kind))
    return Trial(
        victim,
        kind,
        reaction,
        bar_ms,
        reaction is not None and reaction <= bar_ms and not coasted,
        *base,
    )


def _settle(pid: int) -> None:
    """Wait until the process has worked as long as `orbitd run` asks of one that it does not take
    for a crashing one: the pauses before restarts are proven elsewhere."""
    ticks = int(Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[19])
    lived_s = time.clock_gettime(time.CLOCK_BOOTTIME) - ticks / os.sysconf("SC_CLK_TCK")
    time.sleep(max(0.0, GOOD_START_S + 0.5 - lived_s))


def _bar_ms(device: Device, victim: str, kind: str) -> int:
    """The retreat value is to be the target after this time, as NODE_STATE shows it."""
    a, authority = device.setting.config.machine.actuator, device.setting.config.authority
    if victim == "guard":
        return a.time_to_live_ms + a.command_period_ms + NODE_CYCLE_MS + REPORT_MS
    age_ms = round(authority.advice_age_max_ms) if kind == "STOP" else 0
    return age_ms + CYCLE_MS + REPORT_MS


def _retreat_ms(device: Device, seen: Seen, sent_ns: int) -> float | None:
    safe_um = device.setting.config.machine.actuator.safe_radial_clearance_um
    for t_ns, state in seen.states:
        if t_ns > sent_ns and abs(state.target_clearance_um - safe_um) < 0.1:
            return round((t_ns - sent_ns) * 1e-6, 1)
    return None


def _back_ms(seen: Seen, sent_ns: int, session: int) -> float | None:
    """First heartbeat of the guard's next run."""
    later = (t_ns for t_ns, beat in seen.beats if t_ns > sent_ns and beat.session != session)
    first = next(later, None)
    return None if first is None else round((first - sent_ns) * 1e-6, 1)


def _permit_gap_ms(seen: Seen, sent_ns: int) -> float | None:
    """Longest time without a heartbeat that grants; None where none granted any more."""
    grants = [t_ns for t_ns, beat in seen.beats if beat.run_permit]
    if not grants or grants[-1] < sent_ns:
        return None
    return round(max((b - a for a, b in itertools.pairwise(grants)), default=0) * 1e-6, 1)


def _alarm_ms(subscriber: Any, sent_ns: int) -> float | None:
    """The guard's own time of its first word about missing samples."""
    while subscriber is not None and (sample := subscriber.try_recv()) is not None:
        event = msgspec.json.decode(sample.payload.to_bytes(), type=Event)
        if event.t_ns > sent_ns and event.name in ("no_samples", "samples_stale", "recovery"):
            return round((event.t_ns - sent_ns) * 1e-6, 1)
    return None


def _until(holds: Callable[[], bool], within_s: float) -> bool:
    end_s = time.monotonic() + within_s
    while not holds() and time.monotonic() < end_s:
        time.sleep(0.01)
    return holds()


# ------------------------------------------------------------------ events on disk


def lost_events(folder: Path) -> int:
    """Events that the guard dropped because they were said to be on disk, and that are not there.

    An acknowledgement covers everything up to its number, and the guard numbers without gaps:
    within one run of the guard every number up to the last one found must be there.
    """
    found: set[tuple[int, int]] = set()
    for path in sorted(folder.glob("*.mcap")):
        with contextlib.suppress(RecordingError):
            for stored in Recording(path).messages():
                if stored.topic == TOPICS[Event].name:
                    event = msgspec.json.decode(stored.data, type=Event)
                    found.add((event.t_ns, event.seq))
    lost, last = 0, 0
    for _, seq in sorted(found):
        if seq <= last:  # numbers begin anew with each run of the guard
            last = 0
        lost += seq - last - 1
        last = seq
    return lost


# ------------------------------------------------------------------ the whole matrix


def missing(done: list[Trial], repeats: int) -> Iterator[tuple[str, str, int]]:
    """Cells of the table and how many trials each still needs, at most :data:`TRIALS_PER_DEVICE` at
    a time."""
    count = Counter((t.victim, t.signal) for t in done)
    for victim in VICTIMS:
        for kind in SIGNALS:
            left = repeats - count[victim, kind]
            while left > 0:
                yield victim, kind, min(left, TRIALS_PER_DEVICE)
                left -= TRIALS_PER_DEVICE


def table(done: list[Trial], lost: int) -> str:
    """Victim and signal against reaction, time and bar."""
    head = (
        "victim",
        "signal",
        "n",
        "reaction",
        "median ms",
        "worst ms",
        "bar ms",
        "in bar",
        "coasted",
        "back ms",
        "permit gap ms",
        "host stall ms",
    )
    rows = [head]
    for victim in VICTIMS:
        for kind in SIGNALS:
            cell = [t for t in done if (t.victim, t.signal) == (victim, kind)]
            if cell:
                rows.append(_row(victim, kind, cell))
    widths = [max(len(row[i]) for row in rows) for i in range(len(head))]
    lines = [
        "  ".join(word.ljust(width) for word, width in zip(row, widths, strict=True)).rstrip()
        for row in rows
    ]
    return "\n".join([*lines, f"lost acknowledged events: {lost}"])


def _row(victim: str, kind: str, cell: list[Trial]) -> tuple[str, ...]:
    what = {"rig": "alarm", "gate": "target unchanged"}.get(victim, "retreat value")
    times = sorted(t.reaction_ms for t in cell if t.reaction_ms is not None)
    back = [t.back_ms for t in cell if t.back_ms is not None]
    gaps = [t.permit_gap_ms for t in cell if t.permit_gap_ms is not None]
    return (
        victim,
        kind,
        str(len(cell)),
        what,
        _shown(times[len(times) // 2] if times else None),
        _shown(times[-1] if times else None),
        _shown(cell[0].bar_ms),
        f"{sum(t.ok for t in cell)}/{len(cell)}",
        str(sum(t.coasted for t in cell)),
        _shown(max(back, default=None)),
        _shown(max(gaps, default=None)),
        _shown(max(t.host_stall_ms for t in cell)),
    )


def _shown(value: float | None) -> str:
    return "-" if value is None else f"{value:.0f}"


def read(path: Path) -> tuple[list[Trial], int]:
    """Trials and lost events of an earlier run; a half-written last line is left out."""
    done, lost = [], 0
    for line in path.read_text().splitlines() if path.exists() else ():
        with contextlib.suppress(ValueError):
            entry = json.loads(line)
            if "lost_events" in entry:
                lost += entry["lost_events"]
            else:
                done.append(Trial(**entry))
    return done, lost


def main(argv: list[str]) -> int:
    """Run what is missing; 0 when every trial was within its bar and no acknowledged event was
    lost."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--repeats", type=int, default=30, help="trials of each victim and signal (default 30)"
    )
    parser.add_argument(
        "--out",
        type=Path,
        default=Path("kills.jsonl"),
        help="results; an existing file is continued",
    )
    parser.add_argument("--victim", choices=VICTIMS, help="this one alone")
    parser.add_argument("--probe", action="store_true", help=argparse.SUPPRESS)
    options = parser.parse_args(argv)
    if options.probe:
        probe()
    signal.signal(
        signal.SIGTERM, signal.default_int_handler
    )  # told to stop, it ends what it started
    stalls = Stalls()
    stalls.start()
    try:
        given_up = 0
        for victim, kind, count in list(missing(read(options.out)[0], options.repeats)):
            if options.victim not in (None, victim):
                continue
            try:
                _batch(victim, kind, count, stalls, options.out, seed=1 + len(read(options.out)[0]))
            except (
                TrialError
            ) as error:  # the next batch has a fresh device; the same command makes up for this one
                given_up += 1
                print(f"{victim} {kind}: {error}", flush=True)
    finally:
        stalls.stop()
    done, lost = read(options.out)
    print(table(done, lost))
    return 0 if all(t.ok for t in done) and not lost and not given_up else 1


def _batch(victim: str, kind: str, count: int, stalls: Stalls, out: Path, seed: int) -> None:
    """Some trials on one fresh device, each written down at once, and how many acknowledged events
    it lost."""
    with tempfile.TemporaryDirectory(prefix="orbitd-kill-") as name, out.open("a") as results:
        os.environ["ORBITD_BUS_DIR"] = f"{name}/bus"
        device = Device(Path(name), seed)
        try:
            for _ in range(count):
                found = trial(device, victim, kind, stalls)
                results.write(json.dumps(asdict(found)) + "\n")
                results.flush()
                verdict = "ok" if found.ok else f"NOT within its bar {found.note}"
                print(f"{victim} {kind}: {_shown(found.reaction_ms)} ms, {verdict}", flush=True)
            device.ready(MODES[victim])
        finally:
            device.stop()
        lost = lost_events(Path(name) / "recording")
        results.write(json.dumps({"lost_events": lost, "victim": victim, "signal": kind}) + "\n")


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

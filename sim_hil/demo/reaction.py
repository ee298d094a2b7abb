"""How fast the guard answers danger, seen from the bus: trials against a real guard process.

``python -m sim_hil.demo.reaction --config FILE --runtime-dir DIR`` is a signal generator in the
place of rig, node and gate.  Each trial arms the guard at a wide clearance, lets the shaft
displacement move past the danger limit within one frame, and waits for the command that carries the
retreat clearance.  The time counts from the frame's own sending, just before it reaches the guard's
socket, to the command's arrival here; the configured danger delay is part of it.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import math
import os
import random
import struct
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from firmware_py.config import Config, load
from firmware_py.errors import OrbitdError
from firmware_py.records import (
    Command,
    CommandReply,
    CommandRequest,
    Event,
    EventAck,
    Mode,
    NodeInfo,
    Rejected,
    RigStatus,
    SampleFrame,
    WireMessage,
)
from firmware_py.wire.layout_fields import SampleFlag
from firmware_py.wire.link import codec_for, open_link
from firmware_py.wire.peers import PeerClient
from sim_hil.hil.node import Node
from sim_hil.hil.rig import node_limits
from sim_hil.rigs import load_rig

PRIORITY: Final = 20
"""The guard's own SCHED_FIFO priority."""

TURN_US: Final = 20_000
RADIUS_COUNTS: Final = 300
CENTRE_COUNTS: Final = (0, -2000)
JUMP_COUNTS: Final = 6_000
"""60 um over the samples of one frame: past the danger limit at the wide clearance, within the
bearing there, and no faster than a shaft can move."""

WIDE_UM: Final = 80.0
GIVE_UP_S: Final = 15.0
CALM_S: Final = 0.3


class ReactionError(OrbitdError):
    """The guard did not answer as it must; the text says in which step."""


@dataclass
class Generator:
    """Plausible sample frames at the configured rate, and a node that conforms.

    ``jumped`` shifts both displacement channels; ``jumped_ns`` is when the first such frame was
    sent.
    """

    config: Config
    runtime: Path
    jumped: bool = False
    jumped_ns: int = 0
    command: Command | None = None
    command_ns: int = 0
    replies: list[CommandReply] = field(default_factory=list)
    told: list[str] = field(default_factory=list)
    _shift: int = 0
    _frames: int = 0
    _slow: int = 0
    _requests: int = 0

    def __post_init__(self) -> None:
        self._codec = codec_for(self.config)
        self._link = open_link(self.config, "rig")
        self._gate = PeerClient(self.runtime / "guard.sock", "gate")
        self._node = Node(node_limits(load_rig("bench"), self.config))
        self._period_us = self.config.sampling.period_us
        self._due_ns = time.monotonic_ns()

    def tick(self) -> None:
        """Send the next sample frame at its time, and take in what came."""
        self._due_ns += 3 * self._period_us * 1000
        time.sleep(max(0, self._due_ns - time.monotonic_ns()) * 1e-9)
        now_ns = time.monotonic_ns()
        if self.jumped and not self.jumped_ns:
            self.jumped_ns = now_ns
        self._send(self._samples())
        self._frames += 1
        self._receive(now_ns)
        if self._frames % 83 == 0:
            self._send_slow()

    def ask(self, verb: str, value: float | None = None, mode: Mode | None = None) -> None:
        """Put one request to the guard, in the gate's place."""
        self._requests += 1
        self._gate.send(CommandRequest(self._requests, verb, value, mode, "reaction"))

    @property
    def connected(self) -> bool:
        """Whether the guard's room is open to us."""
        return self._gate.connected

    def close(self) -> None:
        """Leave bus and room."""
        self._link.close()
        self._gate.close()

    @property
    def _tick_us(self) -> int:
        return self._frames * 3 * self._period_us

    def _send(self, message: WireMessage) -> None:
        self._link.send(self._codec.encode(message, time.monotonic_ns()))

    def _samples(self) -> SampleFrame:
        first, start = self._tick_us, self._shift
        self._shift = JUMP_COUNTS if self.jumped else 0
        shifts = [start + (self._shift - start) * (i + 1) // 3 for i in range(3)]
        rows = b"".join(self._row(first + i * self._period_us, at) for i, at in enumerate(shifts))
        turns = first // TURN_US
        return SampleFrame(
            self._frames & 0xFFFF,
            first & 0xFFFFFFFF,
            (turns * TURN_US) & 0xFFFFFFFF,
            turns & 0xFFFF,
            int(SampleFlag.MARK_VALID),
            rows,
        )

    def _row(self, at_us: int, shift: int) -> bytes:
        angle = 2 * math.pi * (at_us % TURN_US) / TURN_US
        x = CENTRE_COUNTS[0] + shift + round(RADIUS_COUNTS * math.cos(angle))
        y = CENTRE_COUNTS[1] + shift + round(RADIUS_COUNTS * math.sin(angle))
        noise = [random.randint(-20, 20) for _ in range(6)]
        return struct.pack("<8h", x, y, *noise[:4], 1000 + noise[4], 18000 + noise[5])

    def _receive(self, now_ns: int) -> None:
        messages: list[WireMessage | Rejected] = []
        for frame in self._link.receive(now_ns):
            message = self._codec.decode(frame)
            messages.append(message)
            if isinstance(message, Command):
                self.command, self.command_ns = message, frame.arrival_ns
        self._node.receive(messages, self._tick_us)
        self._node.expire(self._tick_us)
        for record in self._gate.poll(now_ns):
            if isinstance(record, CommandReply):
                self.replies.append(record)
            elif isinstance(record, Event):
                self._gate.send(EventAck(record.seq))
                self.told.append(f"{record.name}: {record.text}")

    def _send_slow(self) -> None:
        """Status and node state 20 times a second, node info once."""
        tick, a = self._tick_us & 0xFFFFFFFF, self.config.machine.actuator
        counter = self._slow & 0xFFFF
        self._send(self._node.state(counter, tick, True))
        self._send(
            RigStatus(counter, tick, 40.0, 40.0, self._node.clearance_um, self._node.pressure_bar)
        )
        if self._slow % 20 == 0:
            self._send(
                NodeInfo(
                    self._slow // 20 & 0xFFFF,
                    tick,
                    self.config.bus.schema,
                    self._period_us,
                    a.safe_radial_clearance_um,
                    a.safe_pressure_bar,
                    a.time_to_live_ms,
                    a.rate_um_s,
                )
            )
        self._slow += 1


def trials(generator: Generator, count: int) -> Iterator[float]:
    """Reaction time of each trial, ms."""
    safe_um = generator.config.machine.actuator.safe_radial_clearance_um
    for _ in range(count):
        _arm(generator, safe_um)
        _run_for(generator, random.uniform(0.1, 0.3))
        generator.jumped, generator.jumped_ns = True, 0
        _until(generator, lambda: _safe_since_jump(generator, safe_um), "the safe command")
        yield (generator.command_ns - generator.jumped_ns) * 1e-6
        generator.jumped = False
        _run_for(generator, CALM_S)


def _safe_since_jump(generator: Generator, safe_um: float) -> bool:
    command = generator.command
    return (
        command is not None
        and bool(generator.jumped_ns)
        and generator.command_ns > generator.jumped_ns
        and abs(command.clearance_um - safe_um) < 0.01
    )


def _arm(generator: Generator, safe_um: float) -> None:
    """Reset, arm by hand and go wide; asked again until the guard has seen enough to agree."""
    _until(generator, lambda: generator.connected, "the guard's socket")
    give_up = time.monotonic() + GIVE_UP_S
    while True:
        generator.replies.clear()
        generator.ask("reset")
        generator.ask("mode", mode=Mode.MANUAL)
        generator.ask("arm")
        generator.ask("set_clearance", WIDE_UM)
        _until(generator, lambda: len(generator.replies) == 4, "the guard's replies")
        if all(reply.accepted for reply in generator.replies):
            break
        if time.monotonic() > give_up:
            reasons = [reason for reply in generator.replies for reason in reply.reasons]
            raise ReactionError(f"the guard refuses to arm: {'; '.join(reasons)}")
        _run_for(generator, 0.2)
    _until(
        generator,
        lambda: generator.command is not None and generator.command.clearance_um > safe_um + 1.0,
        "a command wider than safe",
    )


def _until(generator: Generator, holds: Callable[[], bool], what: str) -> None:
    give_up = time.monotonic() + GIVE_UP_S
    while not holds():
        if time.monotonic() > give_up:
            raise ReactionError(
                f"{what} did not come within {GIVE_UP_S:g} s; the guard said last: "
                f"{'; '.join(generator.told[-3:])}"
            )
        generator.tick()


def _run_for(generator: Generator, seconds: float) -> None:
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        generator.tick()


def quantiles(values: list[float]) -> dict[str, float]:
    """Median, 99th percentile and maximum, rounded to a microsecond."""
    ordered = sorted(values)
    at = {"p50": 0.5, "p99": 0.99, "max": 1.0}
    return {
        name: round(ordered[round(share * (len(ordered) - 1))], 3) for name, share in at.items()
    }


def main(argv: list[str]) -> int:
    """Run the trials and print their quantiles as one line of JSON."""
    parser = argparse.ArgumentParser(prog="python -m sim_hil.demo.reaction", description=__doc__)
    parser.add_argument("--rig", type=Path, required=True)
    parser.add_argument("--runtime-dir", type=Path, required=True)
    parser.add_argument("--trials", type=int, default=20)
    options = parser.parse_args(argv)
    config, _ = load(options.rig)
    with contextlib.suppress(PermissionError):
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(PRIORITY))
    generator = Generator(config, options.runtime_dir)
    try:
        times = list(trials(generator, options.trials))
    finally:
        generator.close()
    delay_ms = 1000 * config.limits.danger_delay_s
    print(json.dumps({**quantiles(times), "trials": len(times), "danger_delay_ms": delay_ms}))
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

"""The brain's process on real sockets: it finds guard and gate, beats, comes back, and stops
cleanly."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from firmware_py import notify
from firmware_py.brain.core import BrainCore
from firmware_py.brain.loop import cpu_features, run
from firmware_py.clock import SimClock
from firmware_py.records import Advice, Diagnosis, PeerRecord, WindowRecord
from firmware_py.wire.peers import PeerServer

from .machine import CONFIG, Machine, models


class Stage(SimClock):
    """A simulated clock that lets the outside world act between two cycles of the loop."""

    def __init__(self, now_ns: int, act: Callable[[int], None]) -> None:
        super().__init__(now_ns)
        self._act = act

    def sleep_until(self, t_ns: int) -> None:
        super().sleep_until(t_ns)
        self._act(t_ns)


@pytest.fixture
def rooms(tmp_path: Path) -> Iterator[tuple[PeerServer, PeerServer]]:
    guard, gate = (
        PeerServer(tmp_path / f"{name}.sock", {"brain": None}) for name in ("guard", "gate")
    )
    yield guard, gate
    guard.close()
    gate.close()


def test_records_cross_and_advice_beats(
    tmp_path: Path, rooms: tuple[PeerServer, PeerServer]
) -> None:
    guard, gate = rooms
    machine = Machine()
    heard: dict[str, list[PeerRecord]] = {"guard": [], "gate": []}
    waiting = machine.run(4.0)
    start_ns = machine.offset_ns + 5_000_000_000

    def act(now_ns: int) -> None:
        heard["guard"] += [record for _, record in guard.poll(now_ns)]
        heard["gate"] += [record for _, record in gate.poll(now_ns)]
        due_ns = now_ns - 10_000_000
        while (
            waiting
            and waiting[0].t_acq_ns <= due_ns  # type: ignore[union-attr]
            and guard.connected("brain")
        ):
            assert guard.send("brain", waiting.pop(0))

    clock = Stage(start_ns, act)
    run(
        BrainCore(CONFIG, models(), ""), tmp_path, clock, notify.Notifier(None), lambda: not waiting
    )
    act(clock.now_ns())
    advices = [record for record in heard["guard"] if isinstance(record, Advice)]
    assert len(advices) == pytest.approx(40, abs=3)
    assert {type(record) for record in heard["guard"]} == {Advice}
    assert {Advice, Diagnosis, WindowRecord} <= {type(record) for record in heard["gate"]}
    assert advices[-1].clearance_um == pytest.approx(80.0)


def test_it_comes_back_to_a_guard_that_restarts(tmp_path: Path) -> None:
    servers = {"guard": PeerServer(tmp_path / "guard.sock", {"brain": None})}
    connected: list[bool] = []

    def act(now_ns: int) -> None:
        cycle = len(connected)
        if cycle == 20:
            servers.pop("guard").close()
        if cycle == 30:
            servers["guard"] = PeerServer(tmp_path / "guard.sock", {"brain": None})
        if "guard" in servers:
            servers["guard"].poll(now_ns)
        connected.append("guard" in servers and servers["guard"].connected("brain"))

    run(
        BrainCore(CONFIG, models(), ""),
        tmp_path,
        Stage(0, act),
        notify.Notifier(None),
        lambda: len(connected) > 60,
    )
    servers["guard"].close()
    assert connected[19]
    assert not any(connected[20:30])
    assert connected[-1]


def test_the_process_starts_without_anybody_and_stops_on_sigterm(tmp_path: Path) -> None:
    with PeerServerContext(tmp_path) as guard:
        process = subprocess.Popen(
            [
                sys.executable,
                "-c",
                "import sys; from firmware_py.brain.loop import main; "
                f"sys.exit(main(['--runtime-dir', {str(tmp_path)!r}]))",
            ],
            cwd=Path(__file__).parents[2],
            env=os.environ | {"OMP_NUM_THREADS": "1"},
        )
        try:
            advice = guard.first_advice()
            assert advice.clearance_um is None
            assert "no gap-free samples of a turning shaft yet" in advice.reasons
        finally:
            process.send_signal(signal.SIGTERM)
            assert process.wait(30) == 0


class PeerServerContext:
    """A guard's socket that waits for a brain's first advice."""

    def __init__(self, folder: Path) -> None:
        self._server = PeerServer(folder / "guard.sock", {"brain": None})

    def __enter__(self) -> PeerServerContext:
        return self

    def __exit__(self, *_: object) -> None:
        self._server.close()

    def first_advice(self) -> Advice:
        while True:
            for _, record in self._server.poll(time.monotonic_ns()):
                if isinstance(record, Advice):
                    return record
            time.sleep(0.01)


def test_cpu_features(tmp_path: Path) -> None:
    info = tmp_path / "cpuinfo"
    info.write_text("flags\t: fpu avx avx2 fma sse\n\nflags\t: avx512f\n")
    assert cpu_features(info) == "avx fma avx2"
    assert cpu_features(tmp_path / "absent") == "unknown"

"""A gate with real doors, and the guard's and the brain's ends of its sockets."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from pathlib import Path

import msgspec
import pytest

from firmware_py import config
from firmware_py.config import Config
from firmware_py.gate import keys, session
from firmware_py.gate.client import Client
from firmware_py.gate.core import Gate, GateParts
from firmware_py.gate.models_file import ModelsFile
from firmware_py.gate.normal_file import NormalFile
from firmware_py.gate.recorder import Recorder
from firmware_py.gate.telemetry import Telemetry
from firmware_py.records import ArmState, Block, GuardState, Mode
from firmware_py.wire.peers import PeerClient, PeerServer

UNIX_NS = 1_800_000_000_000_000_000
MODELS = {"classifier.onnx": "0" * 64}


@pytest.fixture(scope="session")
def bench() -> Config:
    return config.load(config.SHIPPED / "bench")[0]


@pytest.fixture
def prefix(bench: Config) -> str:
    return keys.prefix(bench.device.site, bench.device.rig)


class Stage:
    """A gate on a clock of its own, with the other rooms' ends in the test's hand."""

    def __init__(self, config: Config, folder: Path, with_recorder: bool) -> None:
        prefix = keys.prefix(config.device.site, config.device.rig)
        self.config = config
        self.folder = folder
        self.now_ns = 10_000_000_000
        self.guard = PeerServer(folder / "guard.sock", {"brain": None, "gate": None})
        self.recorder = (
            Recorder(
                folder / "recordings",
                "test",
                {"config": msgspec.json.encode(config).decode()},
                100_000_000,
                lambda: UNIX_NS,
            )
            if with_recorder
            else None
        )
        self.telemetry = Telemetry(session.open_device(config.zenoh, folder, prefix), prefix)
        self.gate_end = PeerServer(folder / "gate.sock", {"brain": None})
        self.gate = Gate(
            config,
            GateParts(
                PeerClient(folder / "guard.sock", "gate"),
                self.gate_end,
                self.telemetry,
                self.recorder,
                NormalFile(folder / "state", lambda: UNIX_NS),
                ModelsFile(folder / "state" / "models", lambda: UNIX_NS),
            ),
            MODELS,
            lambda: UNIX_NS,
        )
        self.brain = PeerClient(folder / "gate.sock", "brain")
        self.heard: list[object] = []
        self.until(lambda: self.guard.connected("gate") and self.gate_end.connected("brain"))

    def step(self) -> None:
        """10 ms of the gate's life; what the gate told the guard is appended to ``heard``."""
        self.now_ns += 10_000_000
        self.heard += [record for _, record in self.guard.poll(self.now_ns)]
        self.brain.poll(self.now_ns)
        self.gate.step(self.now_ns)

    def until(self, condition: Callable[[], bool], what: str = "the condition") -> None:
        """Step until ``condition`` holds; real threads and sockets get real time to act."""
        for _ in range(3000):
            self.step()
            if condition():
                return
            time.sleep(0.003)
        raise AssertionError(f"never came: {what}")

    def close(self) -> None:
        self.telemetry.close()
        self.guard.close()
        self.gate_end.close()
        self.brain.close()
        if self.recorder:
            self.recorder.close()


@pytest.fixture
def stage(bench: Config, tmp_path: Path) -> Iterator[Stage]:
    made = Stage(bench, tmp_path, with_recorder=False)
    yield made
    made.close()


@pytest.fixture
def recording_stage(bench: Config, tmp_path: Path) -> Iterator[Stage]:
    made = Stage(bench, tmp_path, with_recorder=True)
    yield made
    made.close()


@pytest.fixture
def client(stage: Stage, prefix: str) -> Iterator[Client]:
    with Client(stage.folder, prefix) as made:
        yield made


@pytest.fixture
def make_state() -> Callable[..., GuardState]:
    def make(**changes: object) -> GuardState:
        state = GuardState(
            seq=1,
            t_ns=1,
            mode=Mode.AUTO,
            arm_state=ArmState.ARMED,
            authority=True,
            authority_reasons=[],
            speed_rad_s=314.0,
            load_estimate_N=100.0,
            clearance_low_um=45.0,
            clearance_high_um=90.0,
            target_clearance_um=60.0,
            target_pressure_bar=1.0,
            clearance_actual_um=59.0,
            peak_to_peak_um=(12.0, 13.0),
            run_permit=True,
            trip_request=False,
            node_following=True,
            alarms=[],
            counters={"frames_in": 5},
        )
        return msgspec.structs.replace(state, **changes)

    return make


@pytest.fixture
def make_block() -> Callable[..., Block]:
    def make(seq: int, samples: bytes, t_acq_ns: int) -> Block:
        return Block(
            seq=seq,
            t_acq_ns=t_acq_ns,
            period_ns=200_000,
            tick_us=t_acq_ns // 1000,
            sample_period_us=200,
            quality=0,
            channel_ok=0xFF,
            speed_rad_s=314.0,
            turn_count=seq,
            mark_ticks_us=[],
            samples=samples,
        )

    return make

"""Makes the golden recordings again: ``python -m tests.golden.make [NAME ...]``, or ``make
golden``.

Each scenario is flown on the simulated clock, recorded by the gate's own recorder, replayed once
for proof, stored as ``NAME.mcap.xz``, and described in ``manifest.json``: what happens, how many
cycles, every event of the guard.
"""

from __future__ import annotations

import lzma
import sys
import tempfile
from pathlib import Path
from typing import Final

import msgspec
from mcap.writer import CompressionType, IndexType, Writer

from firmware_py.config import Config, decode
from firmware_py.gate.loop import metadata, read_models
from firmware_py.gate.recorder import QUEUE_RECORDS, Recorder
from firmware_py.recording import METADATA_NAME, TOPICS, Recordable, Recording, decode_exact
from firmware_py.records import Block, CommandReply, CommandRequest, CycleRecord, Event, Snapshot
from firmware_py.replay.decisions import DecisionReplay
from tests.golden.scenarios import SCENARIOS, Scenario

FOLDER: Final = Path(__file__).parent
MANIFEST: Final = FOLDER / "manifest.json"
BYTES_MAX: Final = 20_000_000
"""All recordings together."""
KEPT: Final = tuple(
    TOPICS[kind].name for kind in (CycleRecord, Snapshot, Event, CommandRequest, CommandReply)
)
UNIX_NS: Final = 1_800_000_000_000_000_000


class Golden(msgspec.Struct):
    """One recording as the manifest describes it; an event is (s since the start, name, severity,
    text)."""

    name: str
    what: str
    link: str
    cycles: int
    snapshots: int
    frames_out: int
    bytes: int
    events: list[tuple[float, str, int, str]]


def main(names: list[str]) -> int:
    """Make the named scenarios (all without names); 1 when they do not show what they are for, or
    are too large."""
    unknown = set(names) - {scenario.name for scenario in SCENARIOS}
    if unknown:
        print(
            f"no scenario {', '.join(sorted(unknown))}; there are "
            f"{', '.join(s.name for s in SCENARIOS)}"
        )
        return 2
    known = {golden.name: golden for golden in manifest()}
    for scenario in SCENARIOS:
        if names and scenario.name not in names:
            continue
        golden = make(scenario, FOLDER / f"{scenario.name}.mcap.xz")
        known[scenario.name] = golden
        happened = ", ".join(dict.fromkeys(name for _, name, _, _ in golden.events))
        print(
            f"{golden.name:<18}{golden.cycles:>6} cycles {golden.bytes / 1e6:5.2f} MB  {happened}",
            flush=True,
        )
        missing = set(scenario.must) - {name for _, name, _, _ in golden.events}
        if missing:
            print(f"{golden.name}: nothing shows {', '.join(sorted(missing))}; change the scenario")
            return 1
    order = [known[scenario.name] for scenario in SCENARIOS if scenario.name in known]
    MANIFEST.write_bytes(msgspec.json.format(msgspec.json.encode(order), indent=1) + b"\n")
    for stray in set(FOLDER.glob("*.mcap.xz")) - {
        FOLDER / f"{golden.name}.mcap.xz" for golden in order
    }:
        stray.unlink()
    total = sum(golden.bytes for golden in order)
    print(f"{len(order)} recordings, {total / 1e6:.1f} MB of {BYTES_MAX / 1e6:.0f}")
    return 0 if total <= BYTES_MAX else 1


def manifest() -> list[Golden]:
    """What there is; nothing before the first making."""
    return (
        msgspec.json.decode(MANIFEST.read_bytes(), type=list[Golden]) if MANIFEST.exists() else []
    )


def make(scenario: Scenario, path: Path) -> Golden:
    """Fly ``scenario`` and store its recording as ``path``."""
    with tempfile.TemporaryDirectory(prefix="orbitd-golden-") as name:
        found = _flown(scenario, Path(name))
        plain = Path(name) / "plain.mcap"
        _store_plain(found, plain)
        path.write_bytes(lzma.compress(plain.read_bytes(), preset=9 | lzma.PRESET_EXTREME))
        return described(scenario.name, scenario.what, scenario.link, plain, path.stat().st_size)


def described(name: str, what: str, link: str, plain: Path, size: int) -> Golden:
    """What the recording ``plain`` holds; its replay agrees.

    Raises
    ------
    RuntimeError
        The guard does not decide the same again, or a part of the recording is missing.
    """
    recording = Recording(plain)
    stored = list(recording.messages())
    cycles = [decode_exact(m, CycleRecord) for m in stored if m.topic == TOPICS[CycleRecord].name]
    snapshots = sum(m.topic == TOPICS[Snapshot].name for m in stored)
    replay = DecisionReplay(_config(recording))
    for _ in replay.run(recording):
        pass
    report = replay.report
    if not report.ok or report.cycles != len(cycles) or report.snapshots_compared != snapshots - 1:
        raise RuntimeError(f"{name}: the recording does not replay: {report}")
    start_ns = cycles[0].cycle.now_ns
    events = [
        (
            round((record.cycle.now_ns - start_ns) * 1e-9, 3),
            event.name,
            int(event.severity),
            event.text,
        )
        for record in cycles
        for event in record.events
    ]
    return Golden(
        name,
        what,
        link,
        len(cycles),
        snapshots,
        sum(len(c.frames_out) for c in cycles),
        size,
        events,
    )


def _config(recording: Recording) -> Config:
    return decode(recording.metadata["config"], recording.path)


def _flown(scenario: Scenario, folder: Path) -> Recording:
    config = scenario.setting().config
    recorder = Recorder(
        folder, scenario.name, metadata(config, read_models(config)), 10**9, lambda: UNIX_NS
    )

    def listen(record: Recordable, now_ns: int) -> None:
        if isinstance(record, Block):
            return
        ticket = recorder.write(record, now_ns)
        while ticket - recorder.stored > QUEUE_RECORDS // 2 and not recorder.trouble:
            pass  # the disk is behind: a simulated clock can wait

    scenario.fly(listen)
    recorder.close()
    if recorder.counters["recorder_lost"]:
        raise RuntimeError(f"{scenario.name}: records were lost on the way to the disk")
    return Recording(next(folder.glob("*.mcap")))


def _store_plain(recording: Recording, path: Path) -> None:
    """The recording without compression of its own, in large chunks, with what the oracle needs: xz
    packs it better."""
    with path.open("wb") as stream:
        writer = Writer(
            stream, chunk_size=1 << 20, compression=CompressionType.NONE, index_types=IndexType.NONE
        )
        writer.start(profile="orbitd", library="orbitd")
        writer.add_metadata(METADATA_NAME, recording.metadata)
        ids = {}
        for topic in TOPICS.values():
            ids[topic.name] = writer.register_channel(topic.name, topic.encoding, 0)
        for message in recording.messages():
            if message.topic in KEPT:
                writer.add_message(ids[message.topic], message.t_ns, message.data, message.t_ns)
        writer.finish()


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

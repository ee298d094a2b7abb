"""Our own flight recordings (MCAP): the fast channels in SI, and the marks."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from firmware_py.config import Config, ConfigError, decode
from firmware_py.recording import TOPICS, Recording, RecordingError, decode_exact
from firmware_py.records import Block
from firmware_py.replay.decisions import DecisionReplay
from models.readers.channel_map import FileRules
from models.readers.signal_file import Channel, SignalFile, SignalFileError


def read(path: Path, rules: FileRules) -> SignalFile:
    """Samples of the longest stretch without a gap; shorter stretches are noted."""
    try:
        recording = Recording(path)
        topic = TOPICS[Block].name
        blocks = [decode_exact(m, Block) for m in recording.messages() if m.topic == topic]
        config = decode(recording.metadata["config"], path)
        blocks = blocks or _replayed(recording, config)
    except (RecordingError, ConfigError, KeyError) as error:
        raise SignalFileError(str(error)) from error
    if not blocks:
        raise SignalFileError(
            f"{path.name}: holds no samples: neither blocks nor cycles of the guard after a "
            "snapshot; record for longer, while the node sends"
        )
    stretches = _stretches(blocks)
    longest = max(stretches, key=_seconds)
    notes = [
        f"{len(stretches)} stretches between gaps; used the longest, from "
        f"{_at(blocks[0], longest[0]):.3f} s for {_seconds(longest):.3f} s of "
        f"{sum(map(_seconds, stretches)):.3f} s"
    ]
    return _file(path, longest, config, notes if len(stretches) > 1 else [])


def _replayed(recording: Recording, config: Config) -> list[Block]:
    """Blocks of a recording that holds the raw frames in their place: the guard makes them
    again."""
    return [
        block for each in DecisionReplay(config).run(recording) for block in each.decision.blocks
    ]


def _stretches(blocks: list[Block]) -> list[list[Block]]:
    found: list[list[Block]] = []
    for block in blocks:
        last = found[-1][-1] if found else None
        if last is None or block.tick_us != last.tick_us + last.instants * last.sample_period_us:
            found.append([])
        found[-1].append(block)
    return found


def _seconds(stretch: list[Block]) -> float:
    return sum(block.instants * block.sample_period_us for block in stretch) * 1e-6


def _at(first: Block, block: Block) -> float:
    return (block.tick_us - first.tick_us) * 1e-6


def _file(path: Path, stretch: list[Block], config: Config, notes: list[str]) -> SignalFile:
    rows = config.machine.channel
    counts = np.concatenate(
        [np.frombuffer(b.samples, "<i2").reshape(-1, b.channels) for b in stretch]
    )
    if counts.shape[1] != len(rows):
        raise SignalFileError(
            f"{path.name}: {counts.shape[1]} channels in the blocks, {len(rows)} in its "
            "configuration; it was not recorded by one device"
        )
    rate = 1e6 / stretch[0].sample_period_us
    ticks = np.concatenate([np.array(b.mark_ticks_us, np.float64) for b in stretch])
    channels = tuple(
        Channel(row.name, counts[:, i] * row.scale + row.offset, row.unit, rate)
        for i, row in enumerate(rows)
    )
    marks_s = (ticks - stretch[0].tick_us) * 1e-6
    return SignalFile(path, channels, {}, marks_s, tuple(notes))

"""The messages of one rig: those whose signals, size and rate its layout tells, and all others."""

from __future__ import annotations

from dataclasses import replace
from struct import pack
from typing import Final

from firmware_py.records import (
    Command,
    DeviceHeartbeat,
    DriveCommand,
    DriveState,
    NodeFigures,
    NodeInfo,
    NodeState,
    ReadingQuality,
    ReadingsFrame,
    RigStatus,
    SampleFrame,
)
from firmware_py.wire.dbc_messages import (
    COMMAND,
    DRIVE,
    DRIVE_STATE,
    FIGURES,
    HASH,
    HEARTBEAT,
    INFO,
    MEASURED,
    NODE,
    STATE,
    STATUS,
    TICK,
    Described,
    Signal,
    enumerated,
    names_of,
    one_bit,
)
from firmware_py.wire.layout import WireLayout, wire_step


def described(layout: WireLayout) -> dict[type, Described]:
    """Every message of ``layout``, by its record."""
    common: dict[type, Described] = {DeviceHeartbeat: HEARTBEAT, Command: COMMAND, NodeState: STATE}
    info = _info(layout)
    if layout.schema == 1:
        return common | {RigStatus: STATUS, SampleFrame: _samples(layout), NodeInfo: info}
    return common | {
        DriveCommand: DRIVE,
        DriveState: DRIVE_STATE,
        ReadingsFrame: _readings(layout),
        SampleFrame: _samples(layout),
        NodeInfo: info,
        NodeFigures: FIGURES,
    }


def _info(layout: WireLayout) -> Described:
    schema, period = layout.schema, layout.period_us
    told = tuple(
        replace(s, comment=s.comment.replace("{schema}", str(schema))) for s in INFO.signals
    )
    values = INFO.values.format(schema=schema, period=period)
    if schema > 1:
        told, values = (*told, HASH), f"{values}, layout_hash {layout.hash:#010x}"
    example = NodeInfo(1, 5_000_000, schema, period, 50.0, 1.0, 100, 50.0, layout.hash)
    return replace(INFO, signals=told, values=values, example=example)


EXAMPLE_COUNTS: Final = (1250, -830, 15, -7, 3, 120, 1000, 13000)
"""First instant of the example of wire schema 1."""


def _samples(layout: WireLayout) -> Described:
    n, instants = len(layout.channels), layout.instants
    head: tuple[Signal, ...] = (
        Signal("tick", 32, TICK + "of instant 0", "us"),
        Signal(
            "mark_tick",
            32,
            "Tick of the newest once-per-turn mark at or before the last instant; valid when "
            "mark_valid is 1",
            "us",
        ),
        Signal("turn_count", 16, "Marks seen since boot, wrapping"),
        one_bit("rig_behind", "1: the rig in software is behind real time"),
        one_bit("mark_valid", "1: at least one mark has been seen"),
        one_bit("drive_coasting", "1: the drive is off"),
    )
    values = tuple(
        Signal(
            f"{c.name}_{i}",
            16,
            f"{c.words}; instant 0 of {instants}" if i == 0 else "",
            c.kind.wire_unit,
            wire_step(c),
            True,
            at=128 if i == 0 and k == 0 else None,
        )
        for i in range(instants)
        for k, c in enumerate(layout.channels)
    )
    known = "counter 4096, tick 5000000 us, mark_tick 4998765 us, turn_count 321, mark_valid 1"
    cycle_us = instants * layout.period_us
    if layout.schema == 1:
        counts = [v + i for i in range(instants) for v in EXAMPLE_COUNTS]
        comment = (
            "Three sampling instants, one sample period apart (NODE_INFO.sample_period), of eight "
            "channels. Cycle time is three sample periods: 600 us at 5 kHz, 300 us at 10 kHz."
        )
        told = (
            f"{known}; instant 0: 12.50 um, -8.30 um, 0.15, -0.07, 0.03 m/s2, 0.120 Pa, 1.000 bar, "
            "1.3000 V; each raw value one higher at instant 1 and two higher at instant 2"
        )
    else:
        counts = [100 + k for k in range(n * instants)]
        head = (*head, _layout_tag(120))
        comment = (
            f"Sampling instants: {instants}, one sample period apart (NODE_INFO.sample_period), of "
            f"{n} channels, all channels of one instant together."
        )
        told = f"{known}, layout {layout.tag}; raw values 100, 101 .. in the order of the signals"
    example = SampleFrame(4096, 5_000_000, 4_998_765, 321, 2, pack(f"<{len(counts)}h", *counts))
    name = "SAMPLES"
    return Described(name, NODE, cycle_us, comment, told, example, (*head, *values))


def _layout_tag(at: int) -> Signal:
    return Signal(
        "layout", 8, "Low byte of layout_hash; a frame of another layout is refused", at=at
    )


def _readings(layout: WireLayout) -> Described:
    head = (
        MEASURED,
        Signal("page", 8, "Which readings this frame carries", most=layout.pages - 1, mux="M"),
        _layout_tag(72),
    )
    slots = layout.slots
    rows: list[Signal] = []
    for number in range(layout.pages):
        for slot, row in enumerate(layout.page(number)):
            mux = f"m{number}"
            rows += [
                Signal(row.name, 32, row.words, row.kind.unit, row.kind.resolution, True,
                       at=96 + 32 * slot, mux=mux),
                Signal(f"{row.name}_age", 8, "Age at tick; 2550 ms: that or older", "ms", 10.0,
                       at=96 + 32 * slots + 8 * slot, mux=mux),
                replace(
                    enumerated(f"{row.name}_quality", names_of(ReadingQuality),
                          "What the node says of the reading"),
                    at=96 + 40 * slots + 8 * slot, mux=mux,
                ),
            ]  # fmt: skip
    n = len(layout.page(0))
    example = ReadingsFrame(
        9,
        5_000_000,
        0,
        tuple(1000 * (k + 1) * row.kind.resolution for k, row in enumerate(layout.page(0))),
        (10,) * n,
        (int(ReadingQuality.OK),) * n,
    )
    return Described(
        "READINGS",
        NODE,
        50_000 // max(1, layout.pages),
        f"Slow readings, {layout.pages} page(s) in turn, all of them every 50 ms.",
        f"counter 9, tick 5000000 us, page 0, layout {layout.tag}; raw values 1000, 2000 .., ages "
        "10 ms, OK",
        example,
        (*head, *rows),
    )

"""Replay of decisions against a machine's own normal state: the state travels in the recording."""

from __future__ import annotations

import msgspec
import pytest

from firmware_py.brain.commissioning import belonging
from firmware_py.brain.core import BrainCore
from firmware_py.brain.loop import cpu_features
from firmware_py.guard.core import GuardCore
from firmware_py.records import Baseline, Diagnosis, Normal, WindowRecord
from firmware_py.replay import command
from firmware_py.wire.link import codec_for
from sim_hil.closed_loop import ClosedLoop
from sim_hil.hil.rig import Rig, node_limits
from sim_hil.rigs import load_rig
from tests.brain.machine import models

from .test_replay import BENCH, SESSION, START_NS, record

MODELS = models(fleet=True)
assert MODELS.classifier is not None
NORMAL = Normal(
    belongs=belonging(MODELS.classifier, BENCH),
    minutes=1.0,
    decisions=24,
    points=6,
    ranges={"speed_rad_s": (100.0, 1300.0)},
    offset=[3.0, 5.0],
    variance=[1.2, 1.1],
    scale=[1.0, 1.1],
    quiet=[0.0] * 4,
    baseline=Baseline([6.5, 6e-5, 0.3], [0.5, 2e-5, 0.2], [(1.0, -2.0)] * 5, 0.2),
)


@pytest.fixture(scope="module")
def told():
    """Three seconds; the state comes after half of them."""
    found = []
    codec, rig = codec_for(BENCH), load_rig("bench")
    loop = ClosedLoop(
        Rig(rig, codec, node_limits(rig, BENCH), 7),
        GuardCore(BENCH, codec, SESSION),
        lambda: BrainCore(BENCH, MODELS, cpu_features()),
        [lambda item, now_ns: found.append((item, now_ns))],
        START_NS,
    )
    for millisecond in range(3_000):
        if millisecond == 1_500:
            loop.device.adopt(NORMAL)
        loop.step()
    return found


@pytest.fixture(autouse=True)
def same_models(monkeypatch):
    monkeypatch.setattr(command, "load_models", lambda _: MODELS)


def test_decisions_come_back_bit_by_bit_across_the_change(told, tmp_path):
    names = [item.normal for item, _ in told if isinstance(item, WindowRecord)]
    assert names[0] == ""
    assert names[-1] != ""
    assert (
        "normal_floating" in [item for item, _ in told if isinstance(item, Diagnosis)][-1].evidence
    )
    report = command.replay(record(told, tmp_path)).diagnoses
    assert report is not None
    assert report.ok, report
    assert report.exact
    assert report.compared == report.recorded == len(names)


def test_another_state_in_the_recording_is_found(told, tmp_path):
    other = msgspec.structs.replace(NORMAL, offset=[3.0, 5.000001])
    swapped = [(other if isinstance(item, Normal) else item, t) for item, t in told]
    report = command.replay(record(swapped, tmp_path)).diagnoses
    assert report is not None
    judged_by_it = sum(item.normal != "" for item, _ in told if isinstance(item, WindowRecord))
    assert report.set_aside == judged_by_it, (
        "its name is not the recorded one: nothing to judge with"
    )

"""Commissioning at the gate: wishes go to the brain, what it learned goes to the disk and to the
next brain."""

from __future__ import annotations

import threading

import msgspec
import pytest

from firmware_py.commands import commission
from firmware_py.gate.normal_file import NormalFile
from firmware_py.gate.requests import MalformedCommandError, parse
from firmware_py.records import (
    Baseline,
    Belonging,
    CommandReply,
    CommandRequest,
    CommissionState,
    Normal,
)
from firmware_py.wire.peers import PeerClient

NORMAL = Normal(
    belongs=Belonging("c" * 64, "f" * 12, "bench", "0" * 12),
    minutes=12.5,
    decisions=300,
    points=17,
    ranges={"speed_rad_s": (157.0, 1257.0), "clearance_m": (40e-6, 1.2e-4)},
    offset=[0.1, -0.25],
    variance=[1.0, 1.5],
    scale=[1.0],
    quiet=[0.0] * 4,
    baseline=Baseline([6.5, 8e-5, 0.3], [0.5, 1e-5, 0.1], [(1.0, -2.0)] * 5, 0.2),
)
NONE = CommissionState(seq=1, t_ns=1, phase="none", text="")


def ask(stage, client, action):
    """Ask over Zenoh while the gate and a brain step; the answer, and what the brain was asked."""
    found, heard = [], []
    thread = threading.Thread(target=lambda: found.append(client.ask("commission", action)))
    thread.start()
    for _ in range(2000):
        stage.now_ns += 10_000_000
        stage.gate.step(stage.now_ns)
        for record in stage.brain.poll(stage.now_ns):
            if isinstance(record, CommandRequest):
                heard.append(record)
                stage.brain.send(CommandReply(record.seq, True, ["note"]))
                stage.brain.send(NONE)
                if record.action == "stop":
                    stage.brain.send(NORMAL)
        if found:
            break
        thread.join(0.003)
    thread.join(5)
    return found[0], heard


def test_a_wish_goes_to_the_brain_and_what_it_learned_to_the_disk_and_back(stage, client):
    reply, heard = ask(stage, client, "stop")
    assert reply.accepted
    assert reply.reasons == ["note"]
    assert [request.action for request in heard] == ["stop"]
    stage.until(lambda: (stage.folder / "state" / "normal.json").is_file(), "the file")
    stored = NormalFile(stage.folder / "state", lambda: 0)
    assert stored.normal is not None
    assert msgspec.structs.replace(stored.normal, made_unix_ns=0) == NORMAL
    assert stored.words() == "2027-01-15 08:00 UTC, 12.5 min at 17 operating points"

    stage.brain.close()
    stage.until(lambda: not stage.gate_end.connected("brain"), "the brain has left")
    stage.brain = PeerClient(stage.folder / "gate.sock", "brain")
    told = []
    poll = stage.brain.poll
    stage.brain.poll = lambda now_ns: told.extend(poll(now_ns)) or []
    stage.until(lambda: told, "the next brain is told")
    assert told == [stored.normal]


def test_what_is_forgotten_leaves_the_disk(stage, client):
    ask(stage, client, "stop")
    stage.until(lambda: (stage.folder / "state" / "normal.json").is_file(), "the file")
    reply, _ = ask(stage, client, "forget")
    assert reply.accepted
    stage.until(lambda: not (stage.folder / "state" / "normal.json").exists(), "no file")


def test_a_damaged_file_is_an_alarm_with_its_name_and_never_used(stage):
    folder = stage.folder / "state"
    folder.mkdir()
    for text in ("{", '{"type": "Normal"}', '{"type": "Advice"}'):
        (folder / "normal.json").write_text(text)
        found = NormalFile(folder, lambda: 0)
        assert found.normal is None
        assert "normal.json: cannot be used" in found.words()
        assert "commission again" in found.words()
    stage.gate._parts.normal.trouble = found.trouble
    assert "normal_file" in [alarm.name for alarm in stage.gate.state(stage.now_ns).alarms]


def test_a_folder_that_cannot_be_written_is_told(tmp_path):
    (tmp_path / "file").write_text("in the way")
    kept = NormalFile(tmp_path / "file", lambda: 0)
    kept.keep(NORMAL)
    assert "cannot be" in kept.words()


def test_a_state_that_the_brain_refuses_is_an_alarm(stage):
    refused = msgspec.structs.replace(NONE, phase="refused", text="learned with classifier 'a'")
    stage.brain.send(refused)
    stage.until(lambda: stage.gate.view.commission == refused)
    assert "normal_refused" not in [a.name for a in stage.gate.state(stage.now_ns).alarms], (
        "the brain has no heartbeat"
    )
    stage.gate.view._heard_ns["brain"] = stage.now_ns
    assert "normal_refused" in [a.name for a in stage.gate.state(stage.now_ns).alarms]


def test_a_malformed_wish_is_named():
    assert parse(1, "commission", "start", "x") == CommandRequest(
        1, "commission", origin="x", action="start"
    )
    with pytest.raises(
        MalformedCommandError, match="'begin' is none of start, stop, cancel, forget"
    ):
        parse(1, "commission", "begin", "x")


@pytest.mark.parametrize(
    ("changed", "stored", "words"),
    [
        ({}, "", "the fleet's: not commissioned"),
        ({"phase": "commissioned"}, "2027-01-15", "this machine's own, 2027-01-15"),
        ({"phase": "commissioned"}, "", "NOT STORED"),
        (
            {"phase": "refused", "text": "other classifier"},
            "2027-01-15",
            "REFUSED, judged by the fleet: other classifier",
        ),
        (
            {
                "phase": "gathering",
                "decisions": 24,
                "minutes": 1.0,
                "points": 5,
                "speed_steps": 3,
                "speed_steps_declared": 11,
                "left_out": {"mode auto": 2},
                "named_faults": {"unbalance": 1},
            },
            "",
            "gathering: 24 decisions in 1.0 min, 5 operating points, 3 of 11 steps of speed",
        ),
    ],
)
def test_status_says_how_commissioning_stands(changed, stored, words):
    said = "\n".join(commission.lines(msgspec.structs.replace(NONE, **changed), stored))
    assert words in said
    assert ("mode auto" in said) == ("left_out" in changed)
    assert "brain is silent" in commission.lines(None, stored)[0]

"""Telemetry, queries and liveliness over a real Zenoh session on the Unix socket."""

from __future__ import annotations

import subprocess
import sys
import threading
from pathlib import Path

import msgspec
import zenoh

from firmware_py.config import Config
from firmware_py.gate.features import SignalFeatures
from firmware_py.gate.session import endpoint
from firmware_py.records import Advice, Alarm, Block, Diagnosis, Event, GuardState, Severity

ADVICE = Advice(
    seq=1,
    t_ns=1,
    t_acq_ns=1,
    lifetime_ns=1,
    clearance_um=60.0,
    pressure_bar=None,
    qualified=False,
    reasons=[],
    forecast=None,
)
DIAGNOSIS = Diagnosis(
    seq=1,
    t_acq_ns=1,
    quality=0,
    verdict="unbalance",
    probability=0.9,
    heads={"unbalance": 0.9},
    classes={"unbalance": 0.9},
    doubt=False,
    unknown=False,
    evidence={},
    model="classifier 1",
)


def deliver(stage, subscriber, send):
    """Send again and again, as the rooms do, until the subscriber has heard one."""
    found = []

    def arrived():
        send()
        found.extend(sample for sample in [subscriber.try_recv()] if sample is not None)
        return bool(found)

    stage.until(arrived, "a sample")
    return found[0]


def test_a_diagnosis_from_the_brain_reaches_a_subscriber_as_json(stage, client):
    subscriber = client.subscribe("ha/diagnosis")
    sample = deliver(stage, subscriber, lambda: stage.brain.send(DIAGNOSIS))
    assert sample.encoding == zenoh.Encoding.APPLICATION_JSON
    assert msgspec.json.decode(sample.payload.to_bytes(), type=Diagnosis) == DIAGNOSIS


def test_raw_blocks_go_out_as_msgpack_and_features_follow(stage, client, make_block):
    blocks = client.subscribe("da/block")
    features = client.subscribe("dm/features")
    block = make_block(1, bytes(2 * 8 * 500), 0)
    sample = deliver(stage, blocks, lambda: stage.guard.send("gate", block))
    assert str(sample.encoding) == "application/msgpack"
    assert msgspec.msgpack.decode(sample.payload.to_bytes(), type=Block) == block
    sample = deliver(stage, features, lambda: stage.guard.send("gate", block))
    decoded = msgspec.json.decode(sample.payload.to_bytes(), type=SignalFeatures)
    assert decoded.channel["disp_x"].rms == 0.0


def test_state_config_models_events_and_alarms_answer_queries(stage, client, make_state, bench):
    alarm = Alarm(
        name="disp_x_danger",
        severity=Severity.DANGER,
        since_ns=5,
        value=80.0,
        limit=70.0,
        latched=True,
    )
    stage.guard.send("gate", make_state(alarms=[alarm]))
    for seq in (1, 2, 3):
        stage.guard.send(
            "gate",
            Event(seq=seq, t_ns=seq, severity=Severity.INFO, name="armed", text=f"armed {seq}"),
        )
    stage.brain.send(ADVICE)
    stage.until(lambda: stage.gate.view.guard is not None and stage.gate.view.advice is not None)

    def query(name, kind):
        return ask_while_stepping(stage, lambda: client.query(name, kind))

    state = ask_while_stepping(stage, client.status)
    assert state.rooms == {"guard": True, "brain": True, "gate": True}
    assert state.guard is not None
    assert state.guard.alarms == [alarm]
    assert query("config", Config) == bench
    assert query("models", dict) == {"classifier.onnx": "0" * 64}
    assert [a.name for a in query("sd/alarms", list[Alarm])] == ["disp_x_danger"]
    assert [e.seq for e in query("event", list[Event])] == [1, 2, 3]
    assert [e.seq for e in query("event?since=2", list[Event])] == [3]
    assert [e.seq for e in query("event?since=nonsense", list[Event])] == [1, 2, 3]


def test_the_alarm_list_is_published_in_full_each_second_and_names_silent_rooms(stage, client):
    sample = deliver(stage, client.subscribe("sd/alarms"), lambda: None)
    names = [a.name for a in msgspec.json.decode(sample.payload.to_bytes(), type=list[Alarm])]
    assert names == ["guard_silent", "brain_silent"]


def test_a_liveliness_token_goes_when_the_heartbeat_is_stale(stage, client, make_state, prefix):
    def living():
        replies = client._session.liveliness().get(f"{prefix}/live/*", timeout=1.0)
        return {str(reply.ok.key_expr).rpartition("/")[2] for reply in replies if reply.ok}

    stage.guard.send("gate", make_state())
    stage.brain.send(ADVICE)
    stage.until(lambda: living() == {"guard", "brain", "gate"}, "three tokens")
    for _ in range(101):
        stage.step()
        stage.brain.send(ADVICE)
    stage.until(lambda: "guard" not in living(), "the guard's token gone")
    assert living() == {"brain", "gate"}


def test_events_are_published_under_their_severity(stage, client):
    event = Event(seq=7, t_ns=1, severity=Severity.DANGER, name="trip", text="tripped")
    sample = deliver(stage, client.subscribe("event/**"), lambda: stage.guard.send("gate", event))
    assert str(sample.key_expr).endswith("/event/danger")
    assert msgspec.json.decode(sample.payload.to_bytes(), type=Event) == event


def test_a_missing_number_is_null_and_the_rest_stays_valid_json(stage, client, make_state):
    state = make_state(load_estimate_N=float("nan"))
    sample = deliver(stage, client.subscribe("sd/state"), lambda: stage.guard.send("gate", state))
    decoded = msgspec.json.decode(sample.payload.to_bytes())
    assert decoded["load_estimate_N"] is None
    assert decoded["type"] == GuardState.__name__


def test_the_bare_script_prints_the_live_diagnosis(stage):
    script = Path(__file__).resolve().parents[2] / "deploy" / "examples" / "zenoh_diagnosis.py"
    child = subprocess.Popen(
        [sys.executable, script, endpoint(stage.folder)], stdout=subprocess.PIPE, text=True
    )
    lines: list[str] = []
    reader = threading.Thread(target=lambda: lines.append(child.stdout.readline()), daemon=True)
    reader.start()
    try:
        stage.until(lambda: stage.brain.send(DIAGNOSIS) and bool(lines), "a printed diagnosis")
    finally:
        child.kill()
        child.wait()
    assert lines[0].split() == ["unbalance", "90.0", "%"]


def test_numbers_that_are_not_finite_cross_exactly_to_our_own_client(stage, client):
    diagnosis = msgspec.structs.replace(DIAGNOSIS, evidence={"novelty_threshold": float("inf")})
    stage.brain.send(diagnosis)
    stage.until(lambda: stage.gate.view.diagnosis is not None)
    assert ask_while_stepping(stage, client.status).diagnosis == diagnosis


def test_counters_that_reply_threads_write_are_there_from_the_start(stage):
    assert {
        "zenoh_failed",
        "replies_dropped_disarm",
        "replies_dropped_commands",
        "replies_dropped_questions",
    } <= set(stage.gate.all_counters())


def ask_while_stepping(stage, ask):
    """Run the blocking ``ask`` while the gate's loop goes on."""
    answers: list[object] = []
    thread = threading.Thread(target=lambda: answers.append(ask()), daemon=True)
    thread.start()
    stage.until(lambda: not thread.is_alive(), "an answer")
    assert answers, "the query failed"
    return answers[0]

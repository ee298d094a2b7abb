"""Command intake: one answer for each wish, whatever the guard does."""

from __future__ import annotations

import socket
import stat
import threading

import pytest

from firmware_py.gate import commands, session
from firmware_py.gate.client import Client, NoAnswerError
from firmware_py.gate.commands import ANSWER_WITHIN_NS, MAX_PENDING, CommandDesk, MalformedCommandError, parse
from firmware_py.gate.session import SessionError
from firmware_py.records import CommandReply, CommandRequest, Mode, PlannedRamp


class Answers(list):
    def __call__(self, reply: CommandReply) -> None:
        self.append(reply)


@pytest.mark.parametrize(("verb", "payload", "value", "mode"), [
    ("arm", b"", None, None), ("disarm", b"null", None, None), ("mode", b'"auto"', None, Mode.AUTO),
    ("set_clearance", b"60", 60.0, None), ("set_pressure", b"1.5", 1.5, None)])
def test_a_wish_becomes_a_request(verb, payload, value, mode):
    assert parse(3, verb, payload, "here") == CommandRequest(seq=3, verb=verb, value=value, mode=mode, origin="here")


def test_an_announcement_becomes_a_request():
    payload = b'{"start_s": 3, "end_s": 5.5, "speed_rpm": 9000, "load_N": 60}'
    expected = CommandRequest(seq=3, verb="announce", origin="here", ramp=PlannedRamp(3.0, 5.5, 9000.0, 60.0))
    assert parse(3, "announce", payload, "here") == expected


@pytest.mark.parametrize(("verb", "payload", "cause"), [
    ("announce", b"", "start_s"), ("announce", b'{"start_s": 3, "end_s": 5, "load_N": 60}', "speed_rpm"),
    ("explode", b"", "use one of mode, arm"), ("arm", b"1", "takes no value"), ("mode", b"2", "monitor, manual, auto"),
    ("mode", b"", "monitor, manual, auto"), ("set_clearance", b"", "um, radial"), ("set_clearance", b"true", "number"),
    ("set_clearance", b'"60"', "number"), ("set_clearance", b"\xff", "no JSON"), ("set_pressure", b"{", "no JSON"),
    ("set_pressure", b"1e999", "finite|no JSON")])
def test_a_malformed_wish_is_named(verb, payload, cause):
    with pytest.raises(MalformedCommandError, match=cause):
        parse(1, verb, payload, "here")


def test_each_reply_finds_who_asked():
    sent: list[CommandRequest] = []
    desk = CommandDesk(lambda request: sent.append(request) or True)
    first, second = Answers(), Answers()
    desk.ask("arm", b"", "a", first, 0)
    desk.ask("reset", b"", "b", second, 0)
    desk.reply(CommandReply(seq=sent[1].seq, accepted=True, reasons=[]))
    desk.reply(CommandReply(seq=sent[0].seq, accepted=False, reasons=["x", "y"]))
    assert [reply.reasons for reply in first] == [["x", "y"]]
    assert [reply.accepted for reply in second] == [True]


def test_a_silent_guard_is_an_answer_at_the_deadline_and_a_late_reply_is_counted():
    desk, answers = CommandDesk(lambda request: True), Answers()
    request = desk.ask("arm", b"", "a", answers, 0)
    desk.step(ANSWER_WITHIN_NS - 1)
    assert not answers
    desk.step(ANSWER_WITHIN_NS)
    assert "did not answer within 1 s" in answers[0].reasons[0]
    desk.reply(CommandReply(seq=request.seq, accepted=True, reasons=[]))
    assert len(answers) == 1
    assert desk.counters["replies_unexpected"] == 1


def test_an_absent_guard_is_an_answer_at_once():
    answers = Answers()
    assert CommandDesk(lambda request: False).ask("arm", b"", "a", answers, 0) is None
    assert "not connected" in answers[0].reasons[0]


def test_a_crowd_is_refused_but_disarm_is_not():
    desk, answers = CommandDesk(lambda request: True), Answers()
    for _ in range(MAX_PENDING):
        assert desk.ask("arm", b"", "a", answers, 0)
    assert desk.ask("arm", b"", "a", answers, 0) is None
    assert "already wait" in answers[0].reasons[0]
    assert desk.ask("disarm", b"", "a", answers, 0)


def test_disarm_is_looked_at_before_all_other_commands(stage, client, monkeypatch):
    replies = []
    ask = [threading.Thread(target=lambda verb=verb: replies.append(client.ask(verb)), daemon=True)
           for verb in ("arm", "reset", "disarm")]
    for thread in ask:
        thread.start()
    stage.until(lambda: sum(isinstance(r, CommandRequest) for r in stage.heard) == 3)
    for request in [r for r in stage.heard if isinstance(r, CommandRequest)]:
        stage.guard.send("gate", CommandReply(seq=request.seq, accepted=request.verb == "disarm", reasons=[]))
    stage.until(lambda: not any(thread.is_alive() for thread in ask))
    assert sorted(reply.accepted for reply in replies) == [False, False, True]
    assert commands.ANSWER_WITHIN_NS > 0


def test_a_command_that_the_guard_ignores_times_out_at_the_gate(stage, client):
    replies = []
    thread = threading.Thread(target=lambda: replies.append(client.ask("set_clearance", 60.0)), daemon=True)
    thread.start()
    stage.until(lambda: not thread.is_alive())
    assert not replies[0].accepted
    assert "did not answer" in replies[0].reasons[0]
    assert [r.value for r in stage.heard if isinstance(r, CommandRequest)] == [60.0]


@pytest.mark.parametrize("leftover", [False, True])
def test_no_gate_is_a_named_error(tmp_path, leftover):
    if leftover:
        with socket.socket(socket.AF_UNIX) as dead:
            dead.bind(str(tmp_path / session.SOCKET))
    with pytest.raises(SessionError, match="no gate at"):
        Client(tmp_path, "orbitd/lab/bench")


def test_only_owner_and_group_may_command(stage):
    assert stat.S_IMODE((stage.folder / session.SOCKET).stat().st_mode) == 0o660


def test_another_device_at_the_same_socket_does_not_answer(stage, monkeypatch):
    monkeypatch.setattr("firmware_py.gate.client.TIMEOUT_S", 0.1)
    with Client(stage.folder, "orbitd/lab/other") as stranger, pytest.raises(NoAnswerError, match="lab/other"):
        stranger.ask("arm")


def test_a_second_gate_takes_over_a_dead_ones_socket(stage, tmp_path_factory, bench):
    folder = tmp_path_factory.mktemp("dead")
    (folder / session.SOCKET).touch()
    session.open_device(bench.zenoh, folder, "orbitd/a/b").close()

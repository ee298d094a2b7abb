"""Command intake: one answer for each wish, whatever the guard does."""

from __future__ import annotations

import re
import socket
import stat
import threading
import time

import msgspec
import pytest

from firmware_py.gate import commands, session
from firmware_py.gate.client import Client, NoAnswerError
from firmware_py.gate.commands import ANSWER_WITHIN_NS, BURST, IDS_KEPT, MAX_PENDING, CommandDesk
from firmware_py.gate.requests import MalformedCommandError, parse, read
from firmware_py.gate.session import SessionError
from firmware_py.records import CommandReply, CommandRequest, Mode, PlannedRamp


class Answers(list):
    def __call__(self, reply: CommandReply) -> None:
        self.append(reply)


@pytest.mark.parametrize(
    ("verb", "payload", "value", "mode"),
    [
        ("arm", b'{"id": "a"}', None, None),
        ("disarm", b'{"id": "a", "value": null}', None, None),
        ("mode", b'{"id": "a", "value": "auto"}', None, Mode.AUTO),
        ("set_clearance", b'{"id": "a", "value": 60}', 60.0, None),
        ("set_pressure", b'{"value": 1.5, "id": "a"}', 1.5, None),
    ],
)
def test_a_wish_becomes_a_request(verb, payload, value, mode):
    wish = read(verb, payload)
    expected = CommandRequest(seq=3, verb=verb, value=value, mode=mode, origin="here", id="a")
    assert parse(3, verb, wish.value, "here", wish.id) == expected


def test_an_announcement_becomes_a_request():
    value = {"start_s": 3, "end_s": 5.5, "speed_rpm": 9000, "load_N": 60}
    expected = CommandRequest(
        seq=3, verb="announce", origin="here", ramp=PlannedRamp(3.0, 5.5, 9000.0, 60.0)
    )
    assert parse(3, "announce", value, "here") == expected


@pytest.mark.parametrize("verb", ["bypass", "shelve"])
def test_a_bypass_and_a_shelved_alarm_become_requests(verb):
    value = {"target": "disp_x", "seconds": 60, "owner": "A. Person", "reason": "new probe"}
    expected = CommandRequest(
        seq=3, verb=verb, origin="here", value=60.0, target="disp_x", owner="A. Person",
        reason="new probe",
    )  # fmt: skip
    assert parse(3, verb, value, "here") == expected


@pytest.mark.parametrize(
    ("verb", "value", "cause"),
    [
        ("bypass", b"null", "bypass"),
        ("bypass", b'{"target": "x"}', "seconds"),
        ("bypass", b'{"target": "x\\n", "seconds": 1}', "target"),
        ("shelve", b'{"target": "x", "seconds": 1e9}', "seconds"),
        ("shelve", b'{"target": "x", "seconds": 1, "more": 2}', "more"),
        ("announce", b"null", "announce"),
        ("announce", b'{"start_s": 3, "end_s": 5, "load_N": 60}', "speed_rpm"),
        ("announce", b"[" * 3000, "too deeply"),
        ("announce", b'{"start_s": ' + b"9" * 400 + b"}", "announce"),
        ("explode", b"null", "use one of mode, arm"),
        ("arm", b"1", "takes no value"),
        ("mode", b"2", "monitor, manual, auto"),
        ("mode", b"null", "monitor, manual, auto"),
        ("mode", b"[[]]", "a list"),
        ("mode", b'"' + b"x" * 3000 + b'"', "monitor, manual, auto"),
        ("set_clearance", b"null", "um, radial"),
        ("set_clearance", b"true", "number"),
        ("set_clearance", b'"60"', "number"),
        ("mode", b'"\xff"', "not UTF-8"),
        ("set_pressure", b"{", "no JSON"),
        ("set_pressure", b"1e999", "out of range"),
        ("set_clearance", b"9" * 400, "beyond 64 bits"),
        ("commission", b"{}", "an object"),
        ("arm", b" " * 5000, "at most 4096"),
    ],
)
def test_a_malformed_wish_is_named_in_few_words(verb, value, cause):
    with pytest.raises(MalformedCommandError, match=cause) as refused:
        parse(1, verb, read(verb, b'{"id": "a", "value": ' + value + b"}").value, "here")
    assert len(str(refused.value)) < 400


@pytest.mark.parametrize(
    "payload",
    [
        b"",
        b"null",
        b"60",
        b'"auto"',
        b"[]",
        b"{}",
        b'{"value": 60}',
        b'{"id": ""}',
        b'{"id": 7}',
        b'{"id": "a b"}',
        b'{"id": "a", "ID": "b"}',
        b"\xff",
        b"\x00",
        b'{"id": "' + b"a" * 65 + b'"}',
        b'{"id": "a", "' + b"[" * 3000 + b'": 1}',
        b'\xef\xbb\xbf{"id": "a"}',
    ],
)
def test_a_payload_without_an_id_is_refused_with_the_right_form(payload):
    with pytest.raises(
        MalformedCommandError, match=r'send a JSON object .*\{"id": "7f3a", "value": 60.0\}'
    ) as refused:
        read("set_clearance", payload)
    assert len(str(refused.value)) < 400


def test_each_reply_finds_who_asked():
    sent: list[CommandRequest] = []
    desk = CommandDesk(lambda request: sent.append(request) or True)
    first, second = Answers(), Answers()
    desk.ask("arm", None, "a", first, 0)
    desk.ask("reset", None, "b", second, 0)
    desk.reply(CommandReply(seq=sent[1].seq, accepted=True, reasons=[]))
    desk.reply(CommandReply(seq=sent[0].seq, accepted=False, reasons=["x", "y"]))
    assert [reply.reasons for reply in first] == [["x", "y"]]
    assert [reply.accepted for reply in second] == [True]


def test_a_silent_guard_is_an_answer_at_the_deadline_and_a_late_reply_is_counted():
    desk, answers = CommandDesk(lambda request: True), Answers()
    request = desk.ask("arm", None, "a", answers, 0)
    desk.step(ANSWER_WITHIN_NS - 1)
    assert not answers
    desk.step(ANSWER_WITHIN_NS)
    assert "did not answer within 1 s" in answers[0].reasons[0]
    desk.reply(CommandReply(seq=request.seq, accepted=True, reasons=[]))
    assert len(answers) == 1
    assert desk.counters["replies_unexpected"] == 1


def test_an_absent_guard_is_an_answer_at_once():
    answers = Answers()
    assert CommandDesk(lambda request: False).ask("arm", None, "a", answers, 0) is None
    assert "not connected" in answers[0].reasons[0]


def test_a_flood_of_one_verb_is_refused_but_disarm_and_the_others_are_not():
    desk, answers = CommandDesk(lambda request: True), Answers()
    for _ in range(int(BURST)):
        assert desk.ask("arm", None, "a", answers, 0)
    assert desk.ask("arm", None, "a", answers, 0) is None
    assert "more than 10 in a second" in answers[-1].reasons[0]
    assert desk.ask("reset", None, "a", answers, 0)
    assert desk.ask("disarm", None, "a", answers, 0)
    assert desk.ask("arm", None, "a", answers, 100_000_000), (
        "a tenth of a second later there is room for one more"
    )
    assert desk.counters["commands_too_fast"] == 1


class Desk:
    """A desk whose guard answers when told to."""

    def __init__(self):
        self.sent: list[CommandRequest] = []
        self.desk = CommandDesk(lambda request: self.sent.append(request) or True)

    def hear(self, verb, request_id, now_ns=0, value=""):
        answers = Answers()
        self.desk.hear(
            verb, b'{"id": "%s"%s}' % (request_id.encode(), value.encode()), "test", answers, now_ns
        )
        return answers

    def guard_answers(self, accepted=True):
        self.desk.reply(CommandReply(seq=self.sent[-1].seq, accepted=accepted, reasons=[]))


@pytest.mark.parametrize("verb", ["arm", "reset", "disarm"])
@pytest.mark.parametrize("accepted", [True, False])
def test_a_repeated_id_is_not_executed_twice_but_answered_the_same(verb, accepted):
    d = Desk()
    first, early = d.hear(verb, "x"), d.hear(verb, "x", 1)
    d.guard_answers(accepted)
    late = d.hear(verb, "x", 2)
    assert len(d.sent) == 1
    assert [a[0].accepted for a in (first, early, late)] == [accepted] * 3
    assert {a[0].id for a in (first, early, late)} == {"x"}
    assert d.desk.counters["commands_repeated"] == 2


def test_an_id_belongs_to_one_command():
    d = Desk()
    d.hear("set_clearance", "x", value=', "value": 60')
    again = d.hear("set_clearance", "x", value=', "value": 61')
    other = d.hear("arm", "x")
    assert len(d.sent) == 1
    assert all("used for another command" in a[0].reasons[0] for a in (again, other))


def test_a_disarm_disarms_even_when_its_id_is_old():
    d = Desk()
    d.hear("disarm", "x")
    d.guard_answers()
    d.hear("arm", "y", 1)
    d.guard_answers()
    d.hear("disarm", "x", 2)
    assert [request.verb for request in d.sent] == ["disarm", "arm", "disarm"]


def test_disarms_of_one_step_are_one_request_unless_something_came_between():
    d = Desk()
    crowd = [d.hear("disarm", f"x{number}") for number in range(5)]
    d.guard_answers()
    assert len(d.sent) == 1
    assert [answers[0].id for answers in crowd] == [f"x{number}" for number in range(5)]
    d.hear("arm", "y")
    d.hear("disarm", "z")
    assert [request.verb for request in d.sent] == ["disarm", "arm", "disarm"]


def test_a_disarm_joins_one_that_still_waits():
    d = Desk()
    crowd = [d.hear("disarm", f"x{number}") for number in range(3)]
    d.guard_answers()
    assert [answers[0].id for answers in crowd] == ["x0", "x1", "x2"]


def test_too_many_that_wait_are_refused_but_no_disarm():
    d = Desk()
    for number in range(MAX_PENDING):
        verb, value = (
            ("arm", ""),
            ("reset", ""),
            ("set_clearance", ', "value": 60'),
            ("set_pressure", ', "value": 1'),
            ("mode", ', "value": "auto"'),
        )[number % 5]
        d.hear(verb, f"x{number}", number * 100_000_000, value)
    assert "already wait" in d.hear("commission", "y", 0, ', "value": "start"')[0].reasons[0]
    assert not d.hear("disarm", "z")


def test_remembered_ids_are_bounded_and_a_flood_of_disarms_forgets_no_other():
    d = Desk()
    d.hear("arm", "y")
    for number in range(IDS_KEPT + 10):
        d.hear("disarm", f"x{number}", number)
    assert sum(len(memory.cases) for memory in d.desk._memory.values()) == IDS_KEPT + 1
    d.hear("arm", "y", 1)
    assert [request.verb for request in d.sent].count("arm") == 1


@pytest.mark.parametrize(
    "selector",
    [
        "orbitd/**",
        "{p}/**",
        "{p}/cmd/*",
        "orbitd/*/*/cmd/arm",
        "**/arm",
        "{p}/cmd/a$*",
        "{p}/*/arm",
        "**",
    ],
)
def test_a_query_with_a_wildcard_executes_nothing_and_is_told_so(stage, client, prefix, selector):
    replies = []
    payload = b'{"id": "w"}'
    thread = threading.Thread(
        target=lambda: replies.extend(
            client._session.get(selector.format(p=prefix), payload=payload, timeout=2.0)
        ),
        daemon=True,
    )
    thread.start()
    stage.until(lambda: not thread.is_alive())
    refused = [
        reply.ok.payload.to_string()
        for reply in replies
        if reply.ok and "/cmd/" in str(reply.ok.key_expr)
    ]
    assert refused
    assert all("names its exact key" in text for text in refused)
    assert stage.gate.all_counters()["commands_wildcard_refused"] == len(refused)
    assert not [record for record in stage.heard if isinstance(record, CommandRequest)]


@pytest.mark.parametrize(
    ("selector", "payload", "cause"),
    [
        ("arm", None, "payload is empty"),
        ("arm", b"", "payload is empty"),
        ("arm?id=x", b'{"id": "x"}', "parameter 'id'"),
        ("arm?_time=[now(-1h)..]", b'{"id": "x"}', "parameter '_time'"),
        ("disarm", b"\xff", "no JSON"),
        ("mode", b'{"id": "x", "value": "\xff"}', "not UTF-8"),
        ("reset", b"null", "wrong|Expected"),
    ],
)
def test_a_command_query_without_its_form_is_refused(
    stage, client, prefix, selector, payload, cause
):
    replies = []
    thread = threading.Thread(
        target=lambda: replies.extend(
            client._session.get(
                f"{prefix}/cmd/{selector}", payload=payload, attachment=b'{"id": "x"}', timeout=2.0
            )
        ),
        daemon=True,
    )
    thread.start()
    stage.until(lambda: not thread.is_alive())
    reply = msgspec.json.decode(replies[0].ok.payload.to_bytes(), type=CommandReply)
    assert not reply.accepted
    assert re.search(cause, reply.reasons[0])
    assert not [record for record in stage.heard if isinstance(record, CommandRequest)]


def test_what_is_put_or_deleted_on_a_command_key_does_nothing(stage, client, prefix):
    client._session.put(f"{prefix}/cmd/arm", b'{"id": "x"}')
    client._session.delete(f"{prefix}/cmd/disarm")
    client._session.put(f"{prefix}/cmd/**", b'{"id": "x"}')
    for _ in range(30):
        stage.step()
        time.sleep(0.003)
    assert not [record for record in stage.heard if isinstance(record, CommandRequest)]


def test_disarm_is_looked_at_before_all_other_commands(stage, client, monkeypatch):
    replies = []
    ask = [
        threading.Thread(target=lambda verb=verb: replies.append(client.ask(verb)), daemon=True)
        for verb in ("arm", "reset", "disarm")
    ]
    for thread in ask:
        thread.start()
    stage.until(lambda: sum(isinstance(r, CommandRequest) for r in stage.heard) == 3)
    for request in [r for r in stage.heard if isinstance(r, CommandRequest)]:
        stage.guard.send(
            "gate", CommandReply(seq=request.seq, accepted=request.verb == "disarm", reasons=[])
        )
    stage.until(lambda: not any(thread.is_alive() for thread in ask))
    assert sorted(reply.accepted for reply in replies) == [False, False, True]
    assert commands.ANSWER_WITHIN_NS > 0


def test_a_command_that_the_guard_ignores_times_out_at_the_gate(stage, client):
    replies = []
    thread = threading.Thread(
        target=lambda: replies.append(client.ask("set_clearance", 60.0)), daemon=True
    )
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
    with (
        Client(stage.folder, "orbitd/lab/other") as stranger,
        pytest.raises(NoAnswerError, match="lab/other"),
    ):
        stranger.ask("arm")


def disarmed(stage, client):
    """Whether ``client`` gets a disarm through to the guard and its answer back."""

    def asked():
        return [record for record in stage.heard if isinstance(record, CommandRequest)]

    replies, before = [], len(asked())
    thread = threading.Thread(target=lambda: replies.append(client.ask("disarm")), daemon=True)
    thread.start()
    stage.until(lambda: len(asked()) > before)
    stage.guard.send("gate", CommandReply(seq=asked()[-1].seq, accepted=True, reasons=[]))
    stage.until(lambda: not thread.is_alive())
    return replies[0].accepted


@pytest.mark.parametrize("removed", [[session.SOCKET], [session.SOCKET, f"{session.SOCKET}.lock"]])
def test_a_removed_socket_is_bound_again_and_old_and_new_clients_are_served(
    stage, client, prefix, removed
):
    stage.telemetry._watch = session.SocketWatch(stage.folder, prefix)
    stage.step()
    for name in removed:
        (stage.folder / name).unlink(missing_ok=True)
    stage.until(lambda: stage.telemetry.counters["zenoh_listened_again"] == 1, "a new socket")
    with Client(stage.folder, prefix) as late:
        for each in (late, client, late):
            assert disarmed(stage, each)
    assert stat.S_IMODE((stage.folder / session.SOCKET).stat().st_mode) == 0o660


def test_a_second_gate_takes_over_a_dead_ones_socket(stage, tmp_path_factory, bench):
    folder = tmp_path_factory.mktemp("dead")
    (folder / session.SOCKET).touch()
    opened = session.open_device(bench.zenoh, folder, "orbitd/a/b")
    with socket.socket(socket.AF_UNIX) as client:
        client.connect(str(folder / session.SOCKET))  # refused by a file that nobody listens at
    opened.close()

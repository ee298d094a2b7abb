"""A ground station on a real UDP socket: what it hears, what it may ask, what garbage does."""

from __future__ import annotations

import random
import socket

import pytest
from pymavlink.dialects.v20 import common

from firmware_py.gate.station import GroundStation, settings
from firmware_py.records import ArmState, CommandReply, CommandRequest, Event, Mode, Severity


class Operator:
    """The station's end: a listening socket and pymavlink's own common dialect."""

    def __init__(self) -> None:
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.bind(("127.0.0.1", 0))
        self.socket.settimeout(0.001)
        self.port = self.socket.getsockname()[1]
        self.mav = common.MAVLink(None, srcSystem=255, srcComponent=190)
        self.heard: list[common.MAVLink_message] = []
        self.device: tuple[str, int] | None = None

    def listen(self) -> None:
        try:
            while True:
                data, self.device = self.socket.recvfrom(2048)
                self.heard += common.MAVLink(None).parse_buffer(data) or []
        except TimeoutError:
            return

    def say(self, message) -> None:
        self.socket.sendto(message.pack(self.mav), self.device)

    def all(self, kind: str) -> list[common.MAVLink_message]:
        return [message for message in self.heard if message.get_type() == kind]


@pytest.fixture
def operator():
    made = Operator()
    yield made
    made.socket.close()


@pytest.fixture
def flying(stage, operator, bench, make_state):
    """A gate with a station, until the station has heard it."""
    stage.gate.station = GroundStation(operator.port, bench, stage.gate.ask)
    stage.guard.send("gate", make_state())
    hear(stage, operator, lambda: operator.all("HEARTBEAT"))
    yield stage
    stage.gate.station.close()


def hear(stage, operator, condition):
    def listened():
        operator.listen()
        return bool(condition())

    stage.until(listened, "word from the device")
    return condition()


def test_the_heartbeat_tells_mode_and_arming(flying, operator, make_state):
    def armed():
        flying.guard.send("gate", make_state(mode=Mode.MANUAL, arm_state=ArmState.ARMED))
        return [h for h in operator.all("HEARTBEAT") if h.custom_mode == Mode.MANUAL]

    beat = hear(flying, operator, armed)[-1]
    assert beat.base_mode & common.MAV_MODE_FLAG_SAFETY_ARMED
    assert beat.system_status == common.MAV_STATE_ACTIVE
    assert beat.type == common.MAV_TYPE_ONBOARD_CONTROLLER
    operator.heard.clear()
    silent = hear(
        flying, operator, lambda: [h for h in operator.all("HEARTBEAT") if h.system_status == 0]
    )[-1]
    assert not silent.base_mode & common.MAV_MODE_FLAG_SAFETY_ARMED


def test_settings_are_listed_read_and_not_changed(flying, operator, bench):
    operator.say(operator.mav.param_request_list_encode(1, 1))
    values = hear(
        flying,
        operator,
        lambda: (v := operator.all("PARAM_VALUE")) and len(v) == v[0].param_count and v,
    )
    assert {v.param_id: v.param_value for v in values} == pytest.approx(settings(bench), rel=1e-6)
    operator.heard.clear()
    operator.say(
        operator.mav.param_set_encode(1, 1, b"DISP_DANGER_UM", 999.0, common.MAV_PARAM_TYPE_REAL32)
    )
    answer = hear(
        flying, operator, lambda: operator.all("PARAM_VALUE") and operator.all("STATUSTEXT")
    )
    assert operator.all("PARAM_VALUE")[0].param_value == bench.limits.displacement_danger_um
    assert "read-only" in answer[0].text
    operator.heard.clear()
    operator.say(operator.mav.param_request_read_encode(1, 1, b"", 2))
    assert hear(flying, operator, lambda: operator.all("PARAM_VALUE"))[0].param_index == 2


@pytest.mark.parametrize(
    ("command", "parameters", "verb", "mode"),
    [
        (common.MAV_CMD_COMPONENT_ARM_DISARM, (1, 0), "arm", None),
        (common.MAV_CMD_COMPONENT_ARM_DISARM, (0, 0), "disarm", None),
        (common.MAV_CMD_DO_SET_MODE, (1, 2), "mode", Mode.AUTO),
    ],
)
def test_commands_reach_the_guard_and_its_answer_comes_back(
    flying, operator, command, parameters, verb, mode
):
    operator.say(operator.mav.command_long_encode(1, 1, command, 0, *parameters, 0, 0, 0, 0, 0))
    flying.until(lambda: any(isinstance(r, CommandRequest) for r in flying.heard))
    request = next(r for r in flying.heard if isinstance(r, CommandRequest))
    assert (request.verb, request.mode, request.origin) == (verb, mode, "mavlink")
    reason = "a reason that is longer than the fifty bytes of one status text, by far"
    flying.guard.send("gate", CommandReply(seq=request.seq, accepted=False, reasons=[reason]))
    ack = hear(
        flying,
        operator,
        lambda: (
            operator.all("COMMAND_ACK")
            and len(operator.all("STATUSTEXT")) == 2
            and operator.all("COMMAND_ACK")
        ),
    )[0]
    assert (ack.command, ack.result) == (command, common.MAV_RESULT_DENIED)
    chunks = operator.all("STATUSTEXT")
    assert "".join(chunk.text for chunk in chunks) == reason
    assert [chunk.chunk_seq for chunk in chunks] == [0, 1]


def test_other_commands_and_other_systems_do_nothing(flying, operator):
    operator.say(
        operator.mav.command_long_encode(1, 1, common.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, 0, 0, 0, 0, 0)
    )
    assert (
        hear(flying, operator, lambda: operator.all("COMMAND_ACK"))[0].result
        == common.MAV_RESULT_UNSUPPORTED
    )
    operator.say(
        operator.mav.command_long_encode(
            9, 1, common.MAV_CMD_COMPONENT_ARM_DISARM, 0, 1, 0, 0, 0, 0, 0, 0
        )
    )
    for _ in range(20):
        flying.step()
    assert not [r for r in flying.heard if isinstance(r, CommandRequest)]


def test_events_are_shown_with_their_severity(flying, operator):
    flying.guard.send(
        "gate", Event(seq=1, t_ns=1, severity=Severity.DANGER, name="trip", text="tripped: disp_x")
    )
    text = hear(flying, operator, lambda: operator.all("STATUSTEXT"))[0]
    assert (text.severity, text.text) == (common.MAV_SEVERITY_CRITICAL, "tripped: disp_x")


def test_garbage_is_counted_and_survived(flying, operator):
    noise = random.Random(3)
    packet = operator.mav.param_request_list_encode(1, 1).pack(operator.mav)
    for length in range(0, 280, 7):
        operator.socket.sendto(noise.randbytes(length), operator.device)
        broken = bytearray(packet)
        broken[noise.randrange(len(broken))] ^= 0x10
        operator.socket.sendto(bytes(broken), operator.device)
        flying.step()
    operator.say(operator.mav.command_long_encode(1, 1, 1, 0, 0, 0, 0, 0, 0, 0, 0))
    assert hear(flying, operator, lambda: operator.all("COMMAND_ACK"))
    assert flying.gate.all_counters()["station_malformed"] > 10
    assert not [r for r in flying.heard if isinstance(r, CommandRequest)]


def test_nobody_listening_is_no_trouble(stage, bench, operator):
    operator.socket.close()
    stage.gate.station = GroundStation(operator.port, bench, stage.gate.ask)
    for _ in range(300):
        stage.step()
    counted = stage.gate.station.counters
    assert counted["station_packets_out"] >= 1
    assert counted["station_lost"] == 0, "what nobody takes does not pile up"
    stage.gate.station.close()


def test_names_fit_the_protocol(bench):
    assert all(len(name) <= 16 for name in settings(bench))

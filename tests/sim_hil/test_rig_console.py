"""The rig's console, over its real socket."""

import json
import socket
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from firmware_py.config import SHIPPED, load
from firmware_py.wire.peer_socket import PeerBusyError
from sim_hil.console import SOCKET_NAME, Console, ConsoleError, NoRig, ask, main
from sim_hil.server import make_rig


class Served:
    """A console polled by a thread of its own; the rig advances only by hand."""

    def __init__(self, folder: Path) -> None:
        config, _ = load(SHIPPED / "bench")
        self.folder = folder
        self.rig = make_rig(config, "bench", 1)
        for i in range(250):
            self.rig.step(1 + i * 1_000_000, [])
        self.console = Console(folder / SOCKET_NAME, self.rig)
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._serve)
        self._thread.start()

    def _serve(self) -> None:
        while not self._stop.is_set():
            self.console.poll()
            time.sleep(0.001)

    def close(self) -> None:
        self._stop.set()
        self._thread.join()
        self.console.close()


@pytest.fixture
def served(tmp_path: Path) -> Iterator[Served]:
    server = Served(tmp_path)
    yield server
    server.close()


def test_faults_come_and_go(served: Served) -> None:
    reply = ask(served.folder, {"verb": "inject", "fault": "pedestal_bolt", "severity": 25})
    assert reply == {"faults": {"pedestal_bolt": 25.0}}
    assert served.rig.machine.faults == {"pedestal_bolt": 25.0}
    ask(served.folder, {"verb": "clear"})
    assert served.rig.machine.faults == {}


@pytest.mark.parametrize(
    ("request_", "why"),
    [
        ({"verb": "inject", "fault": "nothing", "severity": 1}, "choose one of"),
        ({"verb": "inject", "fault": "rub", "severity": 2}, "outside 0 .. 1"),
        ({"verb": "inject", "fault": "rub"}, "bad request"),
        ({"verb": "operating", "speed_rpm": 99999, "load_N": 100}, "outside 0 .. 12000"),
        ({"verb": "operating", "speed_rpm": 6000, "load_N": 1}, "outside 30 .. 300"),
        ({"verb": "duty", "name": "none"}, "published or random"),
        ({"verb": "fly"}, "verbs: inject"),
        ([1, 2], "bad request"),
    ],
)
def test_bad_requests_are_answered_with_their_reason(
    served: Served, request_: dict[str, object], why: str
) -> None:
    with pytest.raises(ConsoleError, match=why):
        ask(served.folder, request_)
    assert ask(served.folder, {"verb": "status"})["faults"] == {}


def test_garbage_is_answered_and_the_console_lives_on(served: Served) -> None:
    with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as sock:
        sock.settimeout(5)
        sock.connect(str(served.folder / SOCKET_NAME))
        sock.send(b"\xff\x00not json")
        assert json.loads(sock.recv(65536))["ok"] is False
    assert ask(served.folder, {"verb": "status"})["coasting"] is False


def test_truth_in_pieces(served: Served) -> None:
    truth = ask(served.folder, {"verb": "truth", "after_ns": 0})["truth"]
    assert len(truth) == 2
    assert ask(served.folder, {"verb": "truth", "after_ns": truth[-1]["t_ns"]})["truth"] == []


def test_duties_and_operating_points(served: Served) -> None:
    assert ask(served.folder, {"verb": "duty", "name": "published"})["seconds"] == 66
    assert (
        ask(served.folder, {"verb": "duty", "name": "random", "seed": 1, "seconds": 30})["seconds"]
        >= 30
    )
    ask(served.folder, {"verb": "operating", "speed_rpm": 3000, "load_N": 200, "ramp_s": 1})
    ask(served.folder, {"verb": "start"})
    ask(served.folder, {"verb": "quit"})
    assert served.console.quit


def test_a_second_rig_of_the_same_instance_is_refused(served: Served) -> None:
    with pytest.raises(PeerBusyError, match="served by another process"):
        Console(served.folder / SOCKET_NAME, served.rig)


def test_no_rig_is_said_so(tmp_path: Path) -> None:
    with pytest.raises(NoRig, match="orbitd hil"):
        ask(tmp_path, {"verb": "status"})


def test_inject_command(served: Served, capsys: pytest.CaptureFixture[str]) -> None:
    where = ["--runtime-dir", str(served.folder)]
    assert main(["unbalance", "--severity", "16", *where]) == 0
    assert "unbalance" in capsys.readouterr().out
    assert main(["status", "--json", *where]) == 0
    assert json.loads(capsys.readouterr().out)["faults"] == {"unbalance": 16.0}
    assert main(["unbalance", "40", *where]) == 0
    assert "40" in capsys.readouterr().out
    with pytest.raises(SystemExit):
        main(["unbalance", *where])
    with pytest.raises(SystemExit):
        main(["operating", *where])

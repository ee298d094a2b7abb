"""Who could put a socket in our place is kept out, and a server of another user is not talked
to."""

from __future__ import annotations

import os
import socket
import time

import can
import pytest

from firmware_py import launch
from firmware_py.records import EventAck
from firmware_py.wire.folders import foreign_server, unsafe
from firmware_py.wire.hub_bus import OrbitdHubBus
from firmware_py.wire.listener import LOOK_EVERY_NS, lock_of
from firmware_py.wire.peer_socket import PeerError
from firmware_py.wire.peers import PeerClient, PeerServer, runtime_dir

STRANGER = 12345
needs_root = pytest.mark.skipif(os.geteuid() != 0, reason="needs root")


@pytest.mark.parametrize(
    ("mode", "cause"), [(0o700, ""), (0o755, ""), (0o777, "everybody"), (0o1777, "everybody")]
)
def test_the_last_folder_is_closed_to_others(tmp_path, mode, cause):
    (tmp_path / "a").mkdir()
    (tmp_path / "a").chmod(mode)
    assert (cause in unsafe(tmp_path / "a")) if cause else unsafe(tmp_path / "a") == ""


@pytest.mark.parametrize(
    ("mode", "safe"), [(0o755, True), (0o1777, True), (0o777, False), (0o757, False)]
)
def test_every_folder_on_the_way_counts_and_a_sticky_one_is_no_danger(tmp_path, mode, safe):
    (tmp_path / "a" / "b" / "c").mkdir(parents=True)
    (tmp_path / "a").chmod(mode)
    assert (unsafe(tmp_path / "a" / "b" / "c") == "") == safe


@needs_root
@pytest.mark.parametrize("whose", ["a", "a/b", "a/b/c", "link"])
def test_a_folder_or_link_of_another_user_is_refused(tmp_path, whose):
    (tmp_path / "a" / "b" / "c").mkdir(parents=True)
    (tmp_path / "link").symlink_to(tmp_path / "a" / "b")
    assert unsafe(tmp_path / "link" / "c") == ""
    os.chown(tmp_path / whose, STRANGER, 0, follow_symlinks=False)
    assert f"belongs to user {STRANGER}" in unsafe(tmp_path / "link" / "c")


@needs_root
def test_the_group_may_not_write_to_a_users_folder(tmp_path, monkeypatch):
    (tmp_path / "a").mkdir()
    os.chown(tmp_path / "a", STRANGER, STRANGER)
    (tmp_path / "a").chmod(0o770)
    monkeypatch.setattr(os, "geteuid", lambda: STRANGER)
    assert f"members of group {STRANGER}" in unsafe(tmp_path / "a")
    (tmp_path / "a").chmod(0o750)
    assert unsafe(tmp_path / "a") == ""


@pytest.mark.parametrize(
    "name", ["../evil", "", "..", ".", "a/b", "x" * 33, "Umlaut\u00e4", "a b", "a\n", "\x00", "A"]
)
def test_an_instance_is_a_name_wherever_it_enters(tmp_path, name):
    with pytest.raises(PeerError, match="a name of 1 to 32"):
        runtime_dir(name, tmp_path)
    parser = launch.argparse.ArgumentParser()
    launch.add_options(parser)
    with pytest.raises(SystemExit):
        launch.from_options(parser.parse_args([f"--instance={name}"]))


@needs_root
def test_a_client_does_not_talk_to_another_users_server(tmp_path):
    room = PeerServer(tmp_path / "guard.sock", {"gate": None})
    client = PeerClient(room.path, "gate", server_uid=STRANGER)
    assert client.poll(0) == []
    assert (client.connected, client.counters["refused_server"]) == (False, 1)
    with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as sock:
        sock.connect(str(room.path))
        assert foreign_server(sock, room.path) == ""
        assert "not by user" in foreign_server(sock, room.path, STRANGER)
    room.close()


@needs_root
def test_a_server_of_another_user_is_trusted_only_where_the_folder_is_shared(tmp_path, monkeypatch):
    with (
        socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as listener,
        socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as sock,
    ):
        path = tmp_path / "guard.sock"
        listener.bind(str(path))
        listener.listen(1)
        sock.connect(str(path))
        monkeypatch.setattr("firmware_py.wire.folders.peer_uid", lambda _: STRANGER)
        assert f"served by user {STRANGER}" in foreign_server(sock, path)
        tmp_path.chmod(0o1770)
        assert f"served by user {STRANGER}" in foreign_server(sock, path), "not the socket's owner"
        os.chown(path, STRANGER, STRANGER)
        assert foreign_server(sock, path) == ""
        path.unlink()
        assert f"served by user {STRANGER}" in foreign_server(sock, path)


def test_what_is_no_folder_or_absent_is_refused(tmp_path):
    (tmp_path / "file").touch()
    assert "not a folder" in unsafe(tmp_path / "file")
    assert "No such file" in unsafe(tmp_path / "absent")


@needs_root
def test_the_bus_folder_is_checked_even_when_it_was_named(tmp_path):
    os.chown(tmp_path, STRANGER, 0)
    with pytest.raises(can.CanInitializationError, match=f"user {STRANGER}"):
        OrbitdHubBus("t", directory=tmp_path)


REMOVALS = {
    "socket": lambda path: path.unlink(),
    "lock": lambda path: lock_of(path).unlink(),
    "both": lambda path: (path.unlink(), lock_of(path).unlink()),
    "replaced": lambda path: (path.unlink(), path.touch()),
    "folder": lambda path: (path.unlink(), lock_of(path).unlink(), path.parent.rmdir()),
}


@pytest.mark.parametrize("removal", REMOVALS)
def test_a_room_listens_again_and_keeps_its_peers(tmp_path, removal):
    (tmp_path / "run").mkdir(mode=0o700)
    room = PeerServer(tmp_path / "run" / "guard.sock", {"brain": None, "gate": None})
    old, new = PeerClient(room.path, "brain"), PeerClient(room.path, "gate")
    old.poll(0)
    room.poll(0)
    room.poll(0)
    REMOVALS[removal](room.path)
    room.poll(LOOK_EVERY_NS)
    assert room.counters["listened_again"] == 1
    new.poll(0)
    room.poll(LOOK_EVERY_NS)
    room.poll(LOOK_EVERY_NS)
    assert new.connected
    assert room.connected("gate")
    assert room.connected("brain")
    assert room.send("brain", EventAck(seq=1))
    assert old.poll(0) == [EventAck(seq=1)]
    with pytest.raises(PeerError, match="served by another process"):
        PeerServer(room.path, {})
    room.close()
    old.close()
    new.close()


@pytest.mark.parametrize("removal", ["socket", "all", "folder"])
def test_the_hub_listens_again_and_old_and_new_nodes_hear_each_other(tmp_path, removal):
    folder = tmp_path / "bus"
    with OrbitdHubBus("t", directory=folder) as old:
        for path in folder.iterdir():
            if removal != "socket" or path.suffix == ".sock":
                path.unlink()
        if removal == "folder":
            folder.rmdir()
        end_s = time.monotonic() + 10
        while not (folder / "t.sock").exists():
            assert time.monotonic() < end_s
            time.sleep(0.05)
        with OrbitdHubBus("t", directory=folder) as new:
            new.send(can.Message(arbitration_id=5, is_extended_id=False, is_fd=True))
            heard = old.recv(5)
            assert heard is not None
            assert heard.arbitration_id == 5


def test_a_hub_whose_place_was_taken_sends_its_nodes_to_the_other(tmp_path):
    with OrbitdHubBus("t", directory=tmp_path) as old:
        (tmp_path / "t.sock").unlink()
        with (
            OrbitdHubBus("t", directory=tmp_path),
            pytest.raises(can.CanOperationError, match="hub lost"),
        ):
            old.recv(10.0)

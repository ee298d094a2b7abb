"""Runs inside user-mode-linux: the link and the examples on `vcan0`. Prints one line per
finding."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import time
from pathlib import Path

from firmware_py.records import Command, NodeState, RawFrame, Rejected, SampleFrame
from firmware_py.wire.can_link import CanLink, bus_opener
from firmware_py.wire.codec import CanCodec

EXAMPLES = Path(__file__).resolve().parents[1] / "examples"
BUS = ("--interface", "socketcan", "--channel", "vcan0")
CODEC = CanCodec()


def check(holds: bool, finding: str) -> None:
    """Print the finding; the first that fails ends the job."""
    print(("ok      " if holds else "FAILED  ") + finding, flush=True)
    if not holds:
        sys.exit(1)


def ip(*words: str) -> None:
    """`ip link ...`."""
    subprocess.run(["ip", "link", *words], check=True)


def listen(link: CanLink, seconds: float) -> None:
    """Keep receiving for some time."""
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        link.receive(time.monotonic_ns())
        time.sleep(0.001)


def start_rig(link: CanLink) -> subprocess.Popen[str]:
    """play_rig, once it is heard: programs start slowly in here."""
    rig = subprocess.Popen(
        [sys.executable, str(EXAMPLES / "play_rig.py"), *BUS, "--seconds", "100", "--rate", "1000"],
        stdout=subprocess.PIPE,
        text=True,
    )
    while not link.receive(time.monotonic_ns()):
        time.sleep(0.01)
    return rig


def examples_work_together(link: CanLink) -> None:
    """The two programs that know the DBC alone."""
    rig = start_rig(link)
    device = subprocess.run(
        [sys.executable, str(EXAMPLES / "play_device.py"), *BUS, "--seconds", "5"],
        stdout=subprocess.PIPE,
        text=True,
        check=True,
    )
    seen = json.loads(device.stdout)
    check(
        seen["instants"] > 1000,
        f"play_device read {seen['instants']} instants, lost {seen['bus'].get('lost')}",
    )
    check(
        seen["states_following"] > 0,
        f"play_rig followed it in {seen['states_following']} of {seen['states']}",
    )
    rig.send_signal(signal.SIGINT)
    played = json.loads(rig.communicate()[0])
    check(played["obeyed"] > 10, f"play_rig obeyed {played['obeyed']} commands")


def link_reads_and_commands(link: CanLink) -> None:
    """CanLink in the device's place."""
    rig = start_rig(link)
    messages = []
    for counter in range(400):
        for frame in link.receive(time.monotonic_ns()):
            messages.append(CODEC.decode(frame))
            if isinstance(messages[-1], SampleFrame):
                link.send(CODEC.encode(Command(counter, 7, messages[-1].tick_us, 61.0, 1.0)))
        time.sleep(0.01)
    rig.kill()
    check(
        not any(isinstance(m, Rejected) for m in messages),
        f"CanLink read {len(messages)} frames, none rejected",
    )
    obeyed = [
        m
        for m in messages
        if isinstance(m, NodeState) and m.session == 7 and m.target_clearance_um == 61.0
    ]
    check(bool(obeyed), f"the node reported CanLink's command {len(obeyed)} times")


def link_survives_its_interface(link: CanLink) -> None:
    """Down, up again, gone."""
    ip("set", "vcan0", "down")
    listen(link, 1.5)
    check(not link.up and "ip link set" in link.fault, f"interface down: {link.fault}")
    check(link.counters["link_lost"] == 1, "one loss counted")
    check(not link.send(RawFrame(0, 1, b"")), "a frame is refused, not lost silently")
    ip("set", "vcan0", "up")
    listen(link, 1.5)
    check(
        link.up and not link.fault and link.send(RawFrame(0, 1, b"")),
        "interface up: back by itself",
    )
    ip("del", "vcan0")
    listen(link, 1.5)
    check(not link.up and "bus.channel" in link.fault, f"interface gone: {link.fault}")


if __name__ == "__main__":
    can_link = CanLink(bus_opener("socketcan", "vcan0"))
    check(can_link.up, "CanLink opened vcan0")
    examples_work_together(can_link)
    link_reads_and_commands(can_link)
    link_survives_its_interface(can_link)
    print("socketcan test: passed", flush=True)

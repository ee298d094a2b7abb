"""Runs as root inside the booted container: follows SERVICE.md, breaks things, prints one line per
check."""

from __future__ import annotations

import json
import os
import pwd
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

PAGE = Path("SERVICE.md").read_text(encoding="utf-8")
ORBITD = "/opt/orbitd/bin/orbitd"
UNITS = Path("/usr/lib/systemd/system")
DEVICE = Path("/etc/orbitd/rig/device.toml")
WATCHDOG_S = {"guard": 1, "brain": 10, "gate": 10}
ROOMS = tuple(WATCHDOG_S)
RIG = "rotor-rig.service"
STRANGER = """
import time
from firmware_py.wire.peers import PeerClient
from pathlib import Path
client = PeerClient(Path("/run/orbitd/guard.sock"), "brain")
for _ in range(20):
    client.poll(time.monotonic_ns())
    time.sleep(0.05)
"""
failures: list[str] = []


def check(name: str, passed: bool, seen: object = "") -> None:
    """Print one line; remember a failure."""
    print(f"{'ok  ' if passed else 'FAIL'} {name}" + (f" ({seen})" if seen != "" else ""))
    if not passed:
        failures.append(name)


def run(*argv: str) -> subprocess.CompletedProcess[str]:
    """Run a command, keep what it says."""
    return subprocess.run(argv, capture_output=True, text=True, check=False)


def follow(section: str) -> None:
    """Run what stands indented in ``section`` of the page, as a person would."""
    text = re.split(r"^## ", PAGE.split(f"## {section}\n")[1], flags=re.MULTILINE)[0]
    for line in re.findall(r"^ {4}(.+)$", text, re.MULTILINE):
        began = time.monotonic()
        done = run("sh", "-c", line)
        seen = (
            f"{time.monotonic() - began:.1f} s"
            if done.returncode == 0
            else (done.stdout + done.stderr)[-1500:]
        )
        check(f"$ {line}", done.returncode == 0, seen)


def wait(condition: Callable[[], bool], limit_s: float) -> str | None:
    """After how long ``condition`` held, None when it did not."""
    start = time.monotonic()
    while time.monotonic() - start < limit_s:
        if condition():
            return f"{time.monotonic() - start:.2f} s"
        time.sleep(0.02)
    return None


def show(unit: str, name: str) -> str:
    """Property ``name`` of a unit."""
    return run("systemctl", "show", "--value", "-p", name, unit).stdout.strip()


def room(name: str) -> str:
    """The unit of a room."""
    return f"orbitd-{name}.service"


def active(name: str) -> bool:
    """Whether a room has told systemd that it is ready."""
    return show(room(name), "SubState") == "running"


def pid(unit: str) -> int:
    """Main process of a unit, 0 for none."""
    return int(show(unit, "MainPID") or 0)


def pids(*units: str) -> dict[str, int]:
    """Main process of each unit."""
    return {unit: pid(unit) for unit in units}


def status() -> dict[str, Any]:
    """What a member of the group reads without any option; empty when nobody answers."""
    answer = run("runuser", "-u", "technician", "--", ORBITD, "status", "--json").stdout
    state: dict[str, Any] = json.loads(answer) if answer else {}
    return state


def turning() -> bool:
    """Whether the guard sees the rotor turn."""
    return ((status().get("guard") or {}).get("speed_rad_s") or 0.0) > 0.0


def frames() -> int:
    """How many frames the guard has taken from the bus."""
    return int((status().get("guard") or {}).get("counters", {}).get("frames_in", 0))


def changed(unit: str, name: str, before: str) -> bool:
    """Whether a property is no longer what it was."""
    return show(unit, name) != before


def replaced(name: str, before: int) -> bool:
    """Whether a room runs as another process."""
    return active(name) and pid(room(name)) not in (0, before)


def all_alive() -> bool:
    """Whether all three rooms are heard."""
    return all(status().get("rooms", {"none": False}).values())


def hubs() -> list[int]:
    """Processes that are a hub."""
    found = run(
        "sh", "-c", "grep -laz 'wire/hub[.]py' /proc/[0-9]*/cmdline"
    ).stdout  # [.]: never finds itself
    return [int(path.split("/")[2]) for path in found.split()]


def units() -> None:
    """What systemd itself thinks of the rendered units."""
    said = run(
        "systemd-analyze",
        "verify",
        *(str(UNITS / room(name)) for name in ROOMS),
        str(UNITS / "orbitd.target"),
    )
    check("systemd-analyze verify prints nothing", not said.stderr + said.stdout, said.stderr)
    for name in ROOMS:
        text = run("systemd-analyze", "security", "--no-pager", room(name)).stdout
        found = re.search(r"exposure level for \S+: ([\d.]+)", text)
        score = float(found[1]) if found else 10.0
        check(f"{name}: exposure <= 2.0", score <= 2.0, score)
    started = run("systemctl", "start", "systemd-networkd").returncode == 0
    log = run("journalctl", "-b", "--no-pager", "-u", "systemd-networkd").stdout
    complaints = [line for line in log.splitlines() if "orbitd" in line]
    check("networkd reads the network file", started and not complaints, complaints or "")


def ready() -> None:
    """Notify, users, processor, watchdog feeding."""
    for name in ROOMS:
        check(f"{name}: READY", wait(partial(active, name), 60) is not None, started_in(room(name)))
        user = pwd.getpwuid(os.stat(f"/proc/{pid(room(name))}").st_uid).pw_name
        check(f"{name}: runs as its own user", user == f"orbitd-{name}", user)
        before = show(room(name), "WatchdogTimestampMonotonic")
        fed = wait(partial(changed, room(name), "WatchdogTimestampMonotonic", before), 5)
        check(f"{name}: feeds the watchdog", fed is not None, f"within {fed}")
    guard, brain = pid(room("guard")), pid(room("brain"))
    check("guard: SCHED_FIFO", os.sched_getscheduler(guard) == os.SCHED_FIFO)
    cores, others = os.sched_getaffinity(guard), os.sched_getaffinity(brain)
    check(
        "guard: a core of its own",
        len(os.sched_getaffinity(0)) == 1 or not cores & others,
        f"{cores}, {others}",
    )


def started_in(unit: str) -> str:
    """From start to READY, as systemd stamped them."""
    begin, end = (
        int(show(unit, f"{what}TimestampMonotonic") or 0)
        for what in ("ExecMainStart", "ActiveEnter")
    )
    return f"{(end - begin) / 1e6:.2f} s after its start"


def flows() -> None:
    """Samples in, brain and gate admitted by user, recording and trip file where they belong."""
    check("samples cross the bus, the rotor turns", (seen := wait(turning, 180)) is not None, seen)
    check("every room is alive", (seen := wait(all_alive, 20)) is not None, status().get("rooms"))
    sizes = {path.name: path.stat().st_size for path in Path("/var/lib/orbitd").iterdir()}
    check("gate: records under ProtectSystem=strict", sum(sizes.values()) > 0, sizes)
    check("guard: keeps its trip file", Path("/var/lib/orbitd-guard/trips.json").exists())
    outsider = run("runuser", "-u", "nobody", "--", ORBITD, "status")
    check("a stranger finds no device", outsider.returncode == 3, outsider.stderr.strip())


def strangers() -> None:
    """A member of the group may command, but may not play the brain."""
    run("systemctl", "stop", room("brain"))
    run("runuser", "-u", "technician", "--", "/opt/orbitd/bin/python", "-c", STRANGER)
    counters = (status().get("guard") or {}).get("counters", {})
    check("guard: refuses a brain of another user", counters.get("room_refused_uid", 0) > 0)
    run("systemctl", "start", room("brain"))


def breaks() -> None:
    """Kill and hang each room: it comes back, nobody else notices."""
    for name in (
        "brain",
        "gate",
        "guard",
    ):  # a guard that hangs is away for longer than the drive waits: last
        others = pids(*(room(other) for other in ROOMS if other != name), RIG)
        hub = hubs()
        for sig, within_s in ((signal.SIGKILL, 30), (signal.SIGSTOP, WATCHDOG_S[name] + 30)):
            before = pid(room(name))
            os.kill(before, sig)
            back = wait(partial(replaced, name, before), within_s)
            what = (
                "back after SIGKILL"
                if sig == signal.SIGKILL
                else "the watchdog ends a hang (SIGSTOP), and back"
            )
            check(f"{name}: {what}", back is not None, back)
        before_and_now = [(others, hub), (pids(*others), hubs())]
        same = before_and_now[0] == before_and_now[1]
        check(
            f"{name}: the others, the rig and the hub went on", same, "" if same else before_and_now
        )
    before = frames()
    check("samples flow again", (seen := wait(lambda: frames() > before, 20)) is not None, seen)
    check(
        "every room is alive again",
        (seen := wait(all_alive, 20)) is not None,
        status().get("rooms"),
    )


def misconfigured() -> None:
    """A configuration error: the unit fails by name instead of starting for ever."""
    good = DEVICE.read_text(encoding="utf-8")
    DEVICE.write_text(good + "\n[nonsense]\n", encoding="utf-8")
    run("systemctl", "restart", room("brain"))
    failed = wait(lambda: show(room("brain"), "ActiveState") == "failed", 20)
    log = run("journalctl", "-b", "--no-pager", "-o", "cat", "-u", room("brain")).stdout
    named = [line for line in log.splitlines() if "nonsense" in line]
    seen = named[-1] if named else log[-500:]
    check("brain: an unknown key fails the unit", failed is not None and bool(named), seen)
    DEVICE.write_text(good, encoding="utf-8")
    run("systemctl", "start", room("brain"))


def stops() -> None:
    """A clean stop of everything, nothing left over."""
    began = time.monotonic()
    run("systemctl", "stop", "orbitd.target")
    took = time.monotonic() - began
    for name in ROOMS:
        state, result = show(room(name), "ActiveState"), show(room(name), "Result")
        check(
            f"{name}: clean stop", (state, result) == ("inactive", "success"), f"{state}, {result}"
        )
    check("all stopped within 5 s", took < 5.0, f"{took:.2f} s")
    run("systemctl", "stop", RIG)
    check("rig: clean stop", show(RIG, "Result") in ("success", ""))
    check(
        "the hub ends after its last client",
        (gone := wait(lambda: not hubs(), 15)) is not None,
        gone,
    )
    left = sorted(path.name for path in Path("/run/orbitd").glob("*.sock"))
    check("no socket is left", not left, left or "")


def removed() -> None:
    """Only configuration and state outlive the removal."""
    left = [str(path) for path in Path("/usr/lib").glob("s*.d/*orbitd*")] + [
        str(p) for p in UNITS.rglob("*orbitd*")
    ]
    check("removed: nothing but configuration and state", not left and DEVICE.exists(), left or "")


def main() -> None:
    """Follow the page from top to bottom, with checks in between."""
    check("a user, technician", run("useradd", "-m", "technician").returncode == 0)
    for section, *steps in (
        ("Install", units, ready),
        ("People",),
        ("Configuration", ready),
        ("Bus", flows, strangers, breaks, misconfigured),
        ("Watching",),
        ("Upgrade", ready, stops),
        ("Remove", removed),
    ):
        print(f"-- {section}")
        follow(section)
        for step in steps:
            step()


try:
    main()
except Exception:
    failures.append("the test itself")
    raise
finally:
    if failures:
        print(
            run("journalctl", "-b", "--no-pager", "-n", "150", "-u", "orbitd-*", "-u", RIG).stdout
        )
    print("result: " + (f"failed: {', '.join(failures)}" if failures else "all passed"))
    sys.stdout.flush()

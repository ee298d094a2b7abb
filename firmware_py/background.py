"""A start that leaves the guard alone: imports at low priority and off its core.

A second of imports by brain or gate on two cores used to hold up the frames of a rig in software,
until the guard had no fresh samples.  While it imports, a process is *nice*, gives no way to wake
up early (``SCHED_BATCH``), and keeps off the last processor where there are two or more (``orbitd
install`` gives that one to the guard).  Under systemd the units say all this for good, and the
calls below may be denied: then nothing happens.

Linux weighs whole sessions against each other before it looks at processes (autogroups,
sched(7)): in a session of its own, as `orbitd run` gives to each process, *nice* alone changes
nothing.  So the leader of a session makes the session nice as well.
"""

from __future__ import annotations

import contextlib
import os
import time
from pathlib import Path
from typing import Final

NICE: Final = 5
"""A third of the weight of others: behind guard and rig, which sleep most of the time, but not
starved by a busy machine (nice 19 or ``SCHED_IDLE`` would be)."""

_OTHER: Final = os.sched_param(0)
AUTOGROUP: Final = Path("/proc/self/autogroup")
RETRIES: Final = 10
"""Who is not root may change a session ten times a second, all together."""

_before: dict[str, set[int]] = {}
"""What :func:`lower` changed; empty when it was not called."""


def lower() -> None:
    """Go to the background, as far as the way back is allowed."""
    cpus = os.sched_getaffinity(0)
    with contextlib.suppress(OSError):
        if len(cpus) > 1:
            os.sched_setaffinity(0, cpus - {max(cpus)})
            _before["cpus"] = cpus
    with contextlib.suppress(OSError):
        os.sched_setscheduler(0, os.SCHED_BATCH, _OTHER)
        _before["policy"] = {os.SCHED_OTHER}
    if may_return():
        os.nice(NICE)
        _before["nice"] = {NICE}
    session = session_nice()
    if session is not None and os.getsid(0) == os.getpid() and (session >= 0 or may_return()):
        _before["session"] = {session}
        _set_session_nice(min(session + NICE, 19))


def restore() -> None:
    """Come back, with every thread that was started meanwhile."""
    for thread in map(int, os.listdir("/proc/self/task")):
        if "policy" in _before:
            with contextlib.suppress(OSError):
                os.sched_setscheduler(thread, os.SCHED_OTHER, _OTHER)
        if "cpus" in _before:
            with contextlib.suppress(OSError):
                os.sched_setaffinity(thread, _before["cpus"])
        if "nice" in _before:
            with contextlib.suppress(OSError):
                os.setpriority(
                    os.PRIO_PROCESS, thread, os.getpriority(os.PRIO_PROCESS, thread) - NICE
                )
    for session in _before.get("session", ()):
        _set_session_nice(session)
    _before.clear()


def session_nice() -> int | None:
    """The nice value of this process's session; None where the kernel does not group by it."""
    try:
        return int(AUTOGROUP.read_text(encoding="ascii").rsplit("nice", 1)[1])
    except (OSError, ValueError, IndexError):
        return None


def _set_session_nice(value: int) -> None:
    for _ in range(RETRIES):
        try:
            AUTOGROUP.write_text(str(value), encoding="ascii")
            return
        except BlockingIOError:
            time.sleep(0.05)
        except OSError:
            return


def may_return() -> bool:
    """Whether this process may lower its nice value again: tried in a child, for rules are many
    (limits, capabilities, user namespaces, system call filters)."""
    child = os.fork()
    if child == 0:
        try:
            os.nice(NICE)
            os.nice(-NICE)
        except OSError:
            os._exit(1)
        os._exit(0)
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 0

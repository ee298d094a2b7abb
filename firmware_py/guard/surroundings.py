"""What changed around the guard: sockets, link, the node's clock, frames of others."""

from __future__ import annotations

from typing import Final

from firmware_py.acquire.stage import AcquireOutput
from firmware_py.guard.alarms.alarm import Notice
from firmware_py.guard.state import Stages
from firmware_py.records import Command, Cycle, Severity

FOREIGN_HOLD_NS: Final = 5_000_000_000
"""How long another device counts as present after it was last heard."""


def connections(g: Stages, cycle: Cycle) -> list[Notice]:
    """Processes and link that came or went."""
    m = g.memory
    notices = link_health(g, cycle)
    now = (cycle.link_up, cycle.gate_connected, cycle.brain_connected)
    if (m.link_up, m.gate_connected, m.brain_connected) == now:
        return notices
    for name, before, after in (
        ("link", m.link_up, cycle.link_up),
        ("gate", m.gate_connected, cycle.gate_connected),
        ("brain", m.brain_connected, cycle.brain_connected),
    ):
        if after and not before:
            notices.append(Notice(Severity.INFO, f"{name}_back", f"{name} connected"))
        elif before and not after:
            notices.append(Notice(Severity.ALERT, f"{name}_lost", gone(name, cycle)))
    if cycle.link_up and not m.link_up:
        g.acquire.reset_clock()
    if not cycle.brain_connected:
        m.advice = None
    m.link_up, m.gate_connected, m.brain_connected = now
    return notices


def link_health(g: Stages, cycle: Cycle) -> list[Notice]:
    """What the link says is wrong with it (bus-off, queue full, no such port), when that
    changes."""
    m, fault = g.memory, cycle.link_fault
    if fault == m.link_fault:
        return []
    if not m.link_fault:
        m.link_fault_ns = cycle.now_ns
    m.link_fault = fault
    if fault:
        return [Notice(Severity.FAULT, "link_fault", fault)]
    lasted_s = (cycle.now_ns - m.link_fault_ns) * 1e-9
    return [Notice(Severity.INFO, "link_well", f"the link is well again, after {lasted_s:.1f} s")]


def discard(g: Stages) -> None:
    """Guard or host was away for longer than the time to live: nothing that was computed is
    valid.

    The clocks may have moved apart in that time, so they are compared anew.
    """
    m = g.memory
    m.cycle_gaps += 1
    g.acquire.reset_clock()
    m.advice, m.interval_m, m.target = None, None, g.arming.safe
    m.shield_due_ns = 0


def foreign_senders(g: Stages, acquired: AcquireOutput, now_ns: int) -> list[Notice]:
    """Frames that only a device sends, but that this one did not."""
    m = g.memory
    notices = []
    for message in acquired.foreign:
        own = message.session == g.session
        if own:
            g.acquire.counters["reject_masquerade"] += 1
        if now_ns - max(m.foreign_command_ns, m.foreign_heartbeat_ns) > FOREIGN_HOLD_NS:
            notices.append(
                Notice(
                    Severity.FAULT,
                    "masquerade" if own else "foreign_device",
                    (
                        f"a frame of session {message.session:#010x} that this device did not "
                        f"send; "
                        "disconnect the other sender"
                    ),
                )
            )
        if own or isinstance(message, Command):
            m.foreign_command_ns = now_ns
        else:
            m.foreign_heartbeat_ns = now_ns
    return notices


def clock_notice(acquired: AcquireOutput) -> Notice:
    """Why node time from before does not count any more."""
    if acquired.restarted:
        return Notice(
            Severity.FAULT,
            "node_restarted",
            "the node has started again; nothing from before counts",
        )
    if acquired.node_ahead_ns:
        return Notice(
            Severity.FAULT,
            "clock_leap",
            (
                f"the node's clock ran {acquired.node_ahead_ns * 1e-6:.0f} ms ahead of this one: "
                f"the host was suspended; "
                "nothing from before counts"
            ),
        )
    return Notice(
        Severity.FAULT,
        "clock_jump",
        (
            "the node's clock does not agree with its frame counter: the node was stopped or its "
            "clock was set; "
            "nothing from before counts"
        ),
    )


def gone(name: str, cycle: Cycle) -> str:
    """That a process or the link has gone, and why where that is known."""
    return (
        f"link gone: {cycle.link_fault}" if name == "link" and cycle.link_fault else f"{name} gone"
    )

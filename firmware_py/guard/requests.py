"""Requests of people: each is answered, accepted or with all reasons why not."""

from __future__ import annotations

from typing import Final, NamedTuple

from firmware_py.guard.alarms.alarm import Notice
from firmware_py.guard.authority.arming import RequestAnswer
from firmware_py.guard.authority.failsafe import Situation
from firmware_py.guard.state import Stages
from firmware_py.records import CommandReply, CommandRequest, Mode, Severity

MOVING: Final = ("arm", "set_clearance", "set_pressure", "announce")
"""Requests that need something to be moved, or an envelope."""


class Answered(NamedTuple):
    """Replies to the requests of one cycle, and what is told of them."""

    replies: list[CommandReply]
    notices: list[Notice]


def answer(g: Stages, commands: list[CommandRequest], situation: Situation) -> Answered:
    """Answer every request; disarm goes first."""
    replies, notices = list[CommandReply](), list[Notice]()
    for request in sorted(commands, key=lambda c: c.verb != "disarm"):
        refused = _refused(request, situation)
        if refused:
            reply, told = CommandReply(request.seq, False, refused), list[Notice]()
        elif request.verb == "reset":
            reply, told = _reset(g, request, situation)
        elif request.verb in ("bypass", "shelve"):
            reply, told = _bypass(g, request, situation.now_ns)
        elif request.verb == "announce":
            reply, told = _announce(g, request, situation.now_ns)
        else:
            reply, told = g.arming.request(request, situation)
            if request.verb == "arm" and reply.accepted:
                g.permit.reset()
        replies.append(reply)
        notices += told
    return Answered(replies, notices)


def _refused(request: CommandRequest, situation: Situation) -> list[str]:
    """Why a machine that is monitor only takes no such request: nothing there can be moved."""
    moves = request.verb in MOVING or (request.verb == "mode" and request.mode != Mode.MONITOR)
    if not (situation.monitor_only and moves):
        return []
    return [f"monitor only: {situation.monitor_only}; see `orbitd check`"]


def _reset(g: Stages, request: CommandRequest, situation: Situation) -> RequestAnswer:
    """Unlatch what no longer stands."""
    left = (
        g.protection.reset()
        + g.oil.reset()
        + [reason for bearing in g.bearings for reason in bearing.reset()]
    )
    left += g.speed_high.reset(g.acquire.speed.lost)
    left += g.added.reset()
    left += g.voting.reset(g.ballot)
    notices = g.speed_check.reset()
    g.arming.reset(left)
    g.permit.reset()
    g.supervision.reset()
    situation.tripped = g.tripped
    text = f"reset from {request.origin}: {len(left)} trips left"
    notices.append(Notice(Severity.INFO, "command", text))
    return RequestAnswer(CommandReply(request.seq, not left, left), notices)


def _announce(g: Stages, request: CommandRequest, now_ns: int) -> RequestAnswer:
    """Take a ramp that is told ahead."""
    refused = g.announcements.request(request, now_ns)
    reply = CommandReply(request.seq, not refused, refused)
    if refused:
        return RequestAnswer(reply, [])
    ramps = len(g.announcements.state)
    text = f"announce accepted from {request.origin}: {ramps} ramps ahead"
    return RequestAnswer(reply, [Notice(Severity.INFO, "command", text)])


def _bypass(g: Stages, request: CommandRequest, now_ns: int) -> RequestAnswer:
    """Bypass a measure or a group, or shelve an alarm."""
    if request.verb == "bypass":
        refused = g.bypasses.request(request, now_ns, g.ballot)
    else:
        refused = g.bypasses.shelve(request, now_ns)
    reply = CommandReply(request.seq, not refused, refused)
    if refused:
        return RequestAnswer(reply, [])
    why = f" by {request.owner}: {request.reason}" if request.owner else ""
    seconds = request.value or 0.0
    text = f"{request.verb} of {request.target} for {seconds:g} s from {request.origin}{why}"
    return RequestAnswer(reply, [Notice(Severity.INFO, "command", text)])

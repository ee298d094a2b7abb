"""The guard as one pure stage: a cycle in, a decision out; the same bits on every machine."""

from __future__ import annotations

import msgspec

from firmware_py.acquire.stage import AcquireOutput
from firmware_py.config import Config
from firmware_py.guard import facts, judging, report, requests, surroundings
from firmware_py.guard.alarms.alarm import Notice
from firmware_py.guard.authority.failsafe import Situation
from firmware_py.guard.authority.model_authority import is_ahead
from firmware_py.guard.authority.speaker import GuardCodec
from firmware_py.guard.protection.permit import Start
from firmware_py.guard.state import NEVER_NS, CoreState, Stages
from firmware_py.records import (
    ArmState,
    CommandReply,
    Cycle,
    Decision,
    Mode,
    RawFrame,
    Severity,
    Snapshot,
)


class GuardCore:
    """Acquisition, protection, shield and arming, one cycle at a time.

    Parameters
    ----------
    config
        The whole configuration (its retreat value checked by
        :func:`firmware_py.guard.envelope.shield_check.check_safe`).
    codec
        Codec of the configured link.
    session
        Nonce of this run, in every frame that the guard sends.
    latched
        Danger alarms that stood latched when the guard last ended.
    start, timers
        How this run began, and how long danger limits had been exceeded when the last one ended,
        ns.
    """

    def __init__(
        self,
        config: Config,
        codec: GuardCodec,
        session: int,
        latched: list[str] | None = None,
        start: Start | None = None,
        timers: dict[str, int] | None = None,
    ) -> None:
        self.stages = Stages(config, codec, session, latched, start, timers)

    def step(self, cycle: Cycle) -> Decision:
        """Read, protect, answer, decide, speak."""
        g, now_ns = self.stages, cycle.now_ns
        notices = surroundings.connections(g, cycle)
        gap = g.away(now_ns)
        if gap:
            surroundings.discard(g)
        acquired = g.acquire.step(cycle.frames, now_ns)
        if acquired.node_ahead_ns or acquired.clock_jumped or acquired.restarted:
            gap = True
            surroundings.discard(g)
            notices.append(surroundings.clock_notice(acquired))
        notices += surroundings.foreign_senders(g, acquired, now_ns)
        notices += judging.judge(g, acquired, now_ns)
        notices += _take_advice(g, cycle)
        if now_ns >= g.memory.shield_due_ns or _command_due(g, cycle):
            facts.look_around(g, now_ns)
        situation = facts.situation(g, cycle, gap)
        answered = requests.answer(g, cycle.commands, situation)
        notices += answered.notices + self._decide(cycle, acquired, situation, answered.replies)
        g.memory.last_ns = now_ns
        events = report.events(g, notices, now_ns)
        state = report.state_when_due(g, now_ns, soon=bool(answered.replies))
        return Decision(
            cycle.seq,
            _speak(g, situation),
            acquired.blocks,
            acquired.readings,
            events,
            answered.replies,
            state,
        )

    def _decide(
        self,
        cycle: Cycle,
        acquired: AcquireOutput,
        situation: Situation,
        replies: list[CommandReply],
    ) -> list[Notice]:
        """Arming, target and permit of this cycle; what changes is told to the node at once."""
        g, now_ns = self.stages, cycle.now_ns
        arming = g.arming.state
        before = (arming.arm_state, arming.mode)
        g.memory.target, notices = g.arming.step(situation, g.memory.advice)
        permit = judging.judge_permit(g, situation, bool(acquired.blocks))
        if g.memory.last_ns == NEVER_NS:
            notices += g.permit.begin(g.protection.tripped)
        notices += permit
        notices += g.unwritable.step(bool(cycle.memory_fault), cycle.memory_fault, now_ns)
        arming = g.arming.state
        if (arming.arm_state, arming.mode) != before or replies or permit:
            g.speaker.hurry(urgent=not replies or arming.arm_state == ArmState.TRIPPED)
        return notices

    def snapshot(self, seq: int, now_ns: int) -> Snapshot:
        """The whole state before cycle ``seq``."""
        return Snapshot(seq, now_ns, msgspec.msgpack.encode(self.stages.state))

    def restore(self, snapshot: Snapshot) -> None:
        """Go on from ``snapshot`` (of a guard with the same configuration)."""
        self.stages.state = msgspec.msgpack.decode(snapshot.state, type=CoreState)

    @property
    def tripped(self) -> list[str]:
        """Names of latched alarms, whether they trip or vote: what the loop keeps over a
        restart."""
        return self.stages.latched

    @property
    def timers(self) -> dict[str, int]:
        """How long each danger limit has been exceeded whose delay is not over, ns: kept over a
        restart as well."""
        return {k: v for each in self.stages.set_points for k, v in each.timers().items()}

    @property
    def barred(self) -> bool:
        """Whether a second restart has withdrawn the permit and nobody has looked since."""
        return self.stages.permit.state.barred

    @property
    def probation(self) -> bool:
        """Whether this run began as a restart, nobody has looked since, and 10 min are not over."""
        return self.stages.permit.state.probation

    @property
    def counters(self) -> dict[str, int]:
        """What came in and what was lost or refused, by name."""
        return report.counters(self.stages)


def _take_advice(g: Stages, cycle: Cycle) -> list[Notice]:
    """Take the newest advice; models that came or went with it are told."""
    m, advice = g.memory, cycle.advice
    if advice is None:
        return []
    m.advice = advice
    m.advices_ahead += is_ahead(advice, cycle.now_ns)
    notices = []
    if advice.models != m.models:
        text = f"{_sets(advice.models)}, before {_sets(m.models)}"
        notices.append(Notice(Severity.INFO, "models_changed", text))
    if advice.beside != m.beside:
        text = f"{_sets(advice.beside)}, before {_sets(m.beside)}"
        notices.append(Notice(Severity.INFO, "models_beside", text))
    m.models, m.beside = advice.models, advice.beside
    return notices + g.models_back.step(bool(advice.rolled_back), advice.rolled_back, cycle.now_ns)


def _sets(names: str) -> str:
    """Sets of models as an event names them."""
    return names or "no set"


def _command_due(g: Stages, cycle: Cycle) -> bool:
    """Whether a command is due that can really be sent: it rests on an interval of its own."""
    due = g.speaker.command_due(cycle.now_ns)
    return due and _may_command(g, g.fresh(cycle.now_ns), cycle.link_up)


def _may_command(g: Stages, fresh: bool, link_up: bool) -> bool:
    """Whether a command that is due may be sent: armed (or tripped from armed), not monitor,
    samples, a link."""
    arming = g.arming.state
    return arming.commanding and arming.mode != Mode.MONITOR and fresh and link_up


def _speak(g: Stages, situation: Situation) -> list[RawFrame]:
    """Heartbeat always; command only while armed (or tripped from armed), fresh, and not in
    monitor mode."""
    target, arming, permit = g.memory.target, g.arming.state, g.permit.state
    now_ns, frames = situation.now_ns, list[RawFrame]()
    if _may_command(g, situation.samples_fresh, situation.link_up):
        frames += g.speaker.command(now_ns, target, g.acquire.newest_tick_us)
    if frames:
        g.supervision.sent(g.speaker.state.command_counter, target, now_ns)
    return frames + g.speaker.heartbeat(
        now_ns, arming.mode, arming.arm_state, permit.granted, permit.trip_request
    )

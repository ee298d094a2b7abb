"""The brain as one pure stage: records of the guard in; diagnosis, forecast and advice out."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import msgspec
import numpy as np
from numpy.typing import NDArray

from firmware_py.acquire.channel_map import ChannelMap
from firmware_py.acquire.windows import Window, Windower, WindowerState
from firmware_py.brain import tree
from firmware_py.brain.commissioning import CommissionerState
from firmware_py.brain.comparison import ComparisonState
from firmware_py.brain.diagnosis import DiagnoserState
from firmware_py.brain.journal import RecentBlocks, Snapshots, split, taken
from firmware_py.brain.line import LineState
from firmware_py.brain.observation import Observer, ObserverState
from firmware_py.brain.policy import PolicyState, Proposal
from firmware_py.brain.prediction import HORIZON_S
from firmware_py.brain.shadow import Shadow, ShadowState
from firmware_py.brain.store import Models
from firmware_py.brain.succession import (
    Library,
    Succession,
    SuccessionState,
    SuccessionTree,
    named,
)
from firmware_py.brain.watch import OrbitWatch, WatchState
from firmware_py.brain.watch_commissioning import WatchCommissioner, WatchCommissionState
from firmware_py.config import Config
from firmware_py.machine.parts import monitor_only
from firmware_py.records import (
    Advice,
    Block,
    BrainSnapshot,
    BrainState,
    CommandRequest,
    Diagnosis,
    Forecast,
    GuardState,
    Normal,
    PeerRecord,
    RigReading,
    WindowRecord,
)

ADVICE_PERIOD_NS: Final = 100_000_000
LIFETIME_NS: Final = 300_000_000
"""Three periods: two lost advices are survived, a third is not."""
STATE_EVERY: Final = 10
"""Advices between two accounts of what was counted."""
WINDOWS_PER_STEP: Final = 2
"""More windows than this in one step mean that the brain is behind: the oldest are dropped,
counted."""


class StepState(msgspec.Struct):
    """What the brain itself remembers between steps; its guard's state without counters."""

    step_seq: int = 0
    advice_seq: int = 0
    next_advice_ns: int | None = None
    newest_ns: int = 0
    windows_dropped: int = 0
    diagnosis: Diagnosis | None = None
    guard: GuardState | None = None


class BrainTree(msgspec.Struct):
    """The whole brain, but for the samples that it still looks back at."""

    step: StepState
    windower: WindowerState
    observer: ObserverState
    diagnoser: DiagnoserState
    commissioner: CommissionerState
    policy: PolicyState
    watch: WatchState | None = None
    watch_commissioner: WatchCommissionState | None = None
    shadow: ShadowState | None = None
    succession: SuccessionTree | None = None


class BrainCore:
    """Windows, diagnosis, prediction and policy; knows the time only from its inputs.

    Parameters
    ----------
    config
        The device's configuration.
    models
        What the store found; absent models withhold what they are needed for.
    cpu_features
        Written into every :class:`~firmware_py.records.WindowRecord`: diagnoses are bit-exact only
        there.
    start, library
        What is in use at the start (``models`` are those of ``start.active``), and where other sets
        come from.
    """

    def __init__(
        self,
        config: Config,
        models: Models,
        cpu_features: str = "",
        start: SuccessionState | None = None,
        library: Library | None = None,
    ) -> None:
        self._config = config
        self._monitor_only = monitor_only(config.machine)
        self._watch = OrbitWatch(config) if self._monitor_only else None
        channels = self._watch.channels if self._watch else ChannelMap.from_config(config)
        self._windower = Windower(channels, config.sampling.rate_hz)
        self._observer = Observer(channels)
        self._sets = Succession(config, models, start, library)
        self._own = WatchCommissioner(self._watch, config) if self._watch else None
        self._shadow: Shadow | None = None
        self._models_due = False
        self._renew_shadow()
        self._pressure_bar = config.machine.actuator.safe_pressure_bar
        self._cpu_features = cpu_features
        self._recent = RecentBlocks(self._windower.most)
        self._snapshots = Snapshots(cpu_features)
        self._state = StepState()

    @property
    def counters(self) -> dict[str, int]:
        """Every count of the brain by name."""
        return {
            **self._windower.counters,
            **self._sets.active.diagnoser.counters,
            **self._sets.active.policy.counters,
            **(self._shadow.counters if self._shadow else {}),
            "windows_dropped": self._state.windows_dropped,
        }

    @property
    def recent(self) -> list[Block]:
        """The blocks that :meth:`restore` needs beside a snapshot of now."""
        return self._recent.all()

    def snapshot(self, seq: int, now_ns: int) -> list[BrainSnapshot]:
        """The whole state before step ``seq``, in parts; the samples are those of
        :attr:`recent`."""
        return split(seq, now_ns, self._cpu_features, self.recent, self._encoded())

    def restore(self, snapshot: Sequence[BrainSnapshot], blocks: Sequence[Block]) -> None:
        """Go on from all parts of a snapshot (of a brain with the same configuration and models).

        Parameters
        ----------
        snapshot
            In the order of their parts.
        blocks
            Those from its ``first_block`` to its ``last_block``.

        Raises
        ------
        msgspec.DecodeError
            Another version wrote it.
        ValueError
            A part or a block is missing.
        ModelError, SetError
            A set of models that was in use then is not there.
        """
        if [part.part for part in snapshot] != list(range(snapshot[0].parts)):
            raise ValueError("a part of the brain's snapshot is missing")
        state = tree.decode(b"".join(part.state for part in snapshot), BrainTree)
        self._state = state.step
        self._recent = RecentBlocks(self._windower.most)
        for block in blocks:
            self._recent.take(block)
        self._windower.restore(state.windower, self.recent)
        self._observer.restore(state.observer, self.recent)
        self._sets.restore(
            state.succession or SuccessionTree(SuccessionState(), None, ComparisonState())
        )
        self._sets.active.state = LineState(
            state.diagnoser, state.commissioner, state.policy, state.step.diagnosis
        )
        self._renew_shadow()
        if self._watch and self._own and state.watch and state.watch_commissioner:
            self._watch.restore(state.watch, self.recent)
            self._own.state = state.watch_commissioner
        if self._shadow is not None and state.shadow is not None:
            self._shadow.restore(state.shadow, self.recent)

    def record_from_here(self) -> None:
        """Let the next step begin with a snapshot: somebody has just begun to record."""
        self._snapshots.due_ns = 0

    def _encoded(self) -> bytes:
        line, sets = self._sets.active.state, self._sets.tree
        self._state.diagnosis = line.diagnosis
        return tree.encode(
            BrainTree(
                self._state,
                self._windower.state,
                self._observer.state,
                line.diagnoser,
                line.commissioner,
                line.policy,
                self._watch.save() if self._watch else None,
                self._own.state if self._own else None,
                self._shadow.state if self._shadow else None,
                sets if sets.state != SuccessionState() else None,
            )
        )

    def _journal(
        self, records: list[PeerRecord], now_ns: int, late: tuple[int, int]
    ) -> list[PeerRecord]:
        """What a replay needs of this step: a part of a snapshot now and then, and what it
        takes."""
        state = self._state
        if now_ns >= self._snapshots.due_ns:
            self._snapshots.put(state.step_seq, now_ns, self.recent, self._encoded())
        step = taken(records, state.step_seq, now_ns, late)
        state.step_seq += 1
        return [*self._snapshots.next_part(), step]

    def step(
        self, records: list[PeerRecord], now_ns: int, late: tuple[int, int] = (0, 0)
    ) -> list[PeerRecord]:
        """Take what guard and gate sent; return what is due at ``now_ns``, oldest first.

        ``late`` are answers that came after their deadline since the step before
        (:meth:`take_late`).
        """
        out, state = self._journal(records, now_ns, late), self._state
        for request in [record for record in records if isinstance(record, CommandRequest)]:
            out += self._obey(request, now_ns)
        refused = self._sets.refusals()
        windows = [window for record in records for window in self._take(record)]
        state.windows_dropped += max(0, len(windows) - WINDOWS_PER_STEP)
        for window in windows[-WINDOWS_PER_STEP:]:
            out += self.diagnose(window)
        out += self._in_shadow(records)
        due_ns = now_ns if state.next_advice_ns is None else state.next_advice_ns
        if now_ns >= due_ns:
            behind = now_ns >= due_ns + ADVICE_PERIOD_NS
            state.next_advice_ns = (now_ns if behind else due_ns) + ADVICE_PERIOD_NS
            out += self._advise(now_ns)
        if self._sets.judge(refused, late, now_ns):
            self._renew_shadow()
            self._models_due = True
        if self._models_due:
            self._models_due = False
            out.append(self._sets.report(state.advice_seq, now_ns))
        return out

    def take_late(self) -> tuple[int, int]:
        """Late answers since the last call, of the models in use and of those beside: a figure of
        this computer's, to be handed to the next :meth:`step`."""
        beside = self._sets.beside
        return self._sets.active.take_late(), beside.take_late() if beside else 0

    def _renew_shadow(self) -> None:
        """Run the classifier of one's own recordings that the sets bring, if any."""
        own = self._sets.own
        if own is None or self._shadow is None or self._shadow.model is not own:
            self._shadow = Shadow(own, self._config) if own else None

    def _in_shadow(self, records: Sequence[PeerRecord]) -> list[PeerRecord]:
        """What the model in shadow would say."""
        if self._shadow is None:
            return []
        diagnosis = self._sets.active.diagnosis
        active = diagnosis.verdict if diagnosis else "none"
        blocks = [record for record in records if isinstance(record, Block)]
        return [said for block in blocks for said in self._shadow.step(block, active)]

    def _take(self, record: PeerRecord) -> list[Window]:
        """Sort one record to whoever needs it; the windows that it completes."""
        if isinstance(record, Block):
            self._recent.take(record)
            self._observer.take(record)
            self._state.newest_ns = record.t_acq_ns
            if self._watch:
                self._watch.take(record)
            return self._windower.step(record)
        if isinstance(record, RigReading):
            self._observer.take(record)
            self._windower.note(record)
        elif isinstance(record, GuardState):
            self._state.guard = msgspec.structs.replace(record, counters={})
        elif isinstance(record, Normal):
            (self._own or self._sets).adopt(record)
        return []

    def _obey(self, request: CommandRequest, now_ns: int) -> list[PeerRecord]:
        """The answer to a wish about models or commissioning, how that stands now, and what was
        learned."""
        if request.verb == "models":
            answer = self._sets.obey(request)
            self._renew_shadow()
            self._models_due = True
            return [answer]
        commissioner = self._own or self._sets.active.commissioner
        reply, learned = commissioner.obey(request)
        if request.action == "forget" and self._sets.beside:
            self._sets.beside.commissioner.obey(request)
        said: list[PeerRecord] = [reply, commissioner.report(self._state.advice_seq, now_ns)]
        return [*said, learned] if learned else said

    def diagnose(self, window: Window) -> list[PeerRecord]:
        """Diagnosis of ``window`` and the record that lets a replay find the same window."""
        line = self._sets.active
        if self._watch and self._own:
            diagnosis = line.diagnosis = self._watch.step(window)
            self._own.gather(diagnosis, self._state.guard)
            normal_name = self._own.normal_name
        else:
            normal_name = line.diagnoser.normal_name
            diagnosis = line.look(window, self._state.guard)
            self._sets.look_beside(window, self._state.guard)
        return [
            diagnosis,
            WindowRecord(
                seq=diagnosis.seq,
                last_t_acq_ns=window.end_ns,
                last_block_seq=window.last_block_seq,
                diagnosis_seq=diagnosis.seq,
                cpu_features=self._cpu_features,
                normal=normal_name,
            ),
        ]

    def _advise(self, now_ns: int) -> list[PeerRecord]:
        state, sets = self._state, self._sets.state
        proposal = self._propose(now_ns)
        state.advice_seq += 1
        forecast = self._forecast(proposal)
        proposes = proposal.clearance_m is not None
        advice = Advice(
            seq=state.advice_seq,
            t_ns=now_ns,
            t_acq_ns=state.newest_ns,
            lifetime_ns=LIFETIME_NS,
            clearance_um=proposal.clearance_m * 1e6 if proposal.clearance_m is not None else None,
            pressure_bar=self._pressure_bar if proposes else None,
            qualified=self._sets.active.policy.qualified,
            reasons=proposal.reasons,
            forecast=forecast,
            models=named(sets.active),
            beside=named(sets.beside or []),
            rolled_back=sets.rolled_back,
        )
        said: list[PeerRecord] = [forecast, advice] if forecast else [advice]
        if state.advice_seq % STATE_EVERY == 0:
            self._models_due = True
            said += [
                BrainState(state.advice_seq, now_ns, self.counters),
                (self._own or self._sets.active.commissioner).report(state.advice_seq, now_ns),
            ]
        return said

    def _propose(self, now_ns: int) -> Proposal:
        """What the active models would do; those beside are asked the same."""
        if self._monitor_only:
            return Proposal(None, [f"monitor only: {reason}" for reason in self._monitor_only])
        present, guard = self._observer.present(), self._state.guard
        proposal = self._sets.active.propose(present, guard, now_ns)
        self._sets.propose_beside(proposal, present, guard, now_ns)
        return proposal

    def _forecast(self, proposal: Proposal) -> Forecast | None:
        """The record of the forecast for where the clearance will be; None without one."""
        outlook, estimate, sensed, um = proposal.forecast, proposal.estimate, proposal.sensed, 1e6
        surrogate = self._sets.active.models.surrogate
        if outlook is None or estimate is None:
            return None
        return Forecast(
            seq=self._state.advice_seq,
            t_acq_ns=self._state.newest_ns,
            quality=0,
            horizon_s=HORIZON_S,
            conditional_on=proposal.expectation,
            clearance_um=float(outlook.clearance_m[0]) * um,
            peak_to_peak_um=_triple(outlook.peak_to_peak_m[0] * um),
            power_W=_triple(outlook.power_W[0]),
            min_film_um=_triple(outlook.min_film_m[0] * um),
            whirl_margin=_triple(outlook.whirl_margin[0]),
            load_N=estimate.load_interval_N,
            viscosity_Pa_s=estimate.viscosity_interval_Pa_s,
            unbalance_kg_m=proposal.unbalance_kg_m,
            model=surrogate.label if surrogate else "",
            now_min_film_um=_triple(sensed.min_film_m[0] * um) if sensed else None,
            now_friction_W=_triple(sensed.friction_W[0]) if sensed else None,
            time_to_limit_s=proposal.time_to_limit_s,
        )


def _triple(values: NDArray[np.float64]) -> tuple[float, float, float]:
    low, expected, high = values.tolist()
    return low, expected, high

"""Which set of models decides, which one runs beside it, and when the former one comes back.

A candidate runs in *shadow*: it sees all that the active set sees, and nothing follows from it.
``promote`` exchanges the two between two looks at the machine, so that what each has learned of it
is kept; the former set runs on beside.  It comes back by ``rollback``, or by itself: when an answer
of the promoted set is not finite, when its answers are late again and again, or when it disagrees
with the former one in more than the configured share of decisions.  Then nothing runs beside, and
the cause stands until a person acts: what was rolled back comes into use again only through shadow
and promotion.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from typing import Final, Protocol

import msgspec

from firmware_py.acquire.windows import Window
from firmware_py.brain.comparison import Comparison, ComparisonState
from firmware_py.brain.errors import ModelError
from firmware_py.brain.line import Line, LineState
from firmware_py.brain.observation import Present
from firmware_py.brain.policy import Proposal
from firmware_py.brain.store import Model, Models
from firmware_py.config import Config
from firmware_py.machine.parts import monitor_only
from firmware_py.model_sets.errors import SetError
from firmware_py.records import (
    CommandReply,
    CommandRequest,
    GuardState,
    ModelsInUse,
    Normal,
)

LATE_MOST: Final = 5
"""Late answers within :data:`LATE_WITHIN_NS`, beyond those of the former set, that cost a promoted
set its place: a busy computer delays both."""
LATE_WITHIN_NS: Final = 60_000_000_000
REFUSED_MOST: Final = 3
"""The same of answers that are not finite, where the former set does not run beside; where it does
and answers, one is enough."""


NAMED_MOST: Final = 3


class Library(Protocol):
    """Where sets come from."""

    def load(self, layers: Sequence[str]) -> Models:
        """The models of ``layers`` on top of the device's own.

        Raises
        ------
        ModelError, SetError
            A set is not there, or one of its files is refused.
        """


class SuccessionState(msgspec.Struct):
    """What is in use (see :class:`~firmware_py.records.ModelsInUse`), and what is held against a
    promoted set, times of late answers in ns and refused ones, and against one in shadow."""

    active: list[str] = []
    beside: list[str] | None = None
    role: str = ""
    former: list[str] | None = None
    rolled_back: str = ""
    late_ns: list[int] = []
    refused: int = 0
    beside_late_ns: list[int] = []


class SuccessionTree(msgspec.Struct):
    """The succession with the line beside and the comparison, for snapshots."""

    state: SuccessionState
    beside: LineState | None
    comparison: ComparisonState


class Succession:
    """The active line, the one beside, and who replaces whom.

    Parameters
    ----------
    config
        The device's configuration.
    models
        Those of ``start.active``.
    start
        What is in use at the start; a set beside is loaded.
    library
        Where others come from; None: nothing can be changed.
    """

    def __init__(
        self,
        config: Config,
        models: Models,
        start: SuccessionState | None = None,
        library: Library | None = None,
    ) -> None:
        self._config, self._library = config, library
        self._comparison = Comparison(config.models)
        self.state = start or SuccessionState()
        self.active = Line(models, config)
        self.beside: Line | None = None
        if self.state.beside is not None:
            try:
                self.beside = self._line(self.state.beside)
            except (ModelError, SetError) as error:
                self.state.rolled_back = f"{self.state.role} not beside: {error}"
                self.state.beside, self.state.role = None, ""

    @property
    def own(self) -> Model | None:
        """The classifier of one's own recordings that runs in shadow."""
        beside = self.beside.models.shadow if self.beside else None
        return beside or self.active.models.shadow

    @property
    def tree(self) -> SuccessionTree:
        """All that changes, but for the active line."""
        beside = self.beside.state if self.beside else None
        return SuccessionTree(self.state, beside, self._comparison.state)

    def restore(self, tree: SuccessionTree) -> None:
        """Go on from ``tree``; the state of the active line is restored by whoever has it.

        Raises
        ------
        ModelError, SetError
            A set that was in use then is not there.
        """
        if tree.state.active != self.state.active:
            self.active = self._line(tree.state.active)
        self.beside = None
        if tree.beside is not None and tree.state.beside is not None:
            self.beside = self._line(tree.state.beside)
            self.beside.state = tree.beside
        self.state, self._comparison.state = tree.state, tree.comparison

    def adopt(self, normal: Normal) -> None:
        """Let both lines judge by the machine's stored normal state."""
        for line in (self.active, self.beside):
            if line is not None:
                line.adopt(normal)

    def report(self, seq: int, t_ns: int) -> ModelsInUse:
        """How it stands."""
        s = self.state
        return ModelsInUse(
            seq,
            t_ns,
            list(s.active),
            None if s.beside is None else list(s.beside),
            s.role,
            None if s.former is None else list(s.former),
            s.rolled_back,
            self.active.labels,
            self.beside.labels if self.beside else [],
            dict(self._comparison.state.counts),
        )

    # ------------------------------------------------------------------ at work

    def look_beside(self, window: Window, guard: GuardState | None) -> None:
        """Let the line beside diagnose ``window``, after the active one has."""
        if self.beside is None or self.active.diagnosis is None:
            return
        self._comparison.diagnoses(self.active.diagnosis, self.beside.look(window, guard))

    def propose_beside(
        self, said: Proposal, present: Present | None, guard: GuardState | None, now_ns: int
    ) -> None:
        """Let the line beside propose, after the active one has ``said`` its own."""
        if self.beside is None:
            return
        would = self.beside.propose(present, guard, now_ns)
        if present is not None:
            self._comparison.proposals(said, would, present, guard, self.active.policy, now_ns)

    def refusals(self) -> tuple[int, int]:
        """Answers refused so far: of the active line, of the one beside."""
        return self.active.refused, self.beside.refused if self.beside else 0

    def judge(self, before: tuple[int, int], late: tuple[int, int], now_ns: int) -> str:
        """Count what went wrong since ``before`` (:meth:`refusals`) and roll back where it must be;
        the cause, empty where nothing changed.

        Parameters
        ----------
        late
            Late answers since the last call, of the active line and of the one beside.
        """
        refused = [after - then for after, then in zip(self.refusals(), before, strict=True)]
        if self.beside is not None:
            for name, count, slow in zip(("active", "beside"), refused, late, strict=True):
                self._comparison.add(f"{name}_refused", count)
                self._comparison.add(f"{name}_late", slow)
        s = self.state
        s.beside_late_ns = _newest(s.beside_late_ns, late[1] - late[0], now_ns)
        if s.role == "shadow" and len(s.beside_late_ns) >= LATE_MOST:
            return self._stop_shadow()
        if s.former is None:
            return ""
        watched = s.role == "former"
        s.refused += max(0, refused[0] - refused[1] * watched)
        s.late_ns = _newest(s.late_ns, late[0] - late[1] * watched, now_ns)
        cause = self._cause(watched)
        return self._back(cause) if cause else ""

    def _stop_shadow(self) -> str:
        """A shadow that holds up the active set goes."""
        s = self.state
        gone, late = " + ".join(s.beside or []), self._late_words(s.beside_late_ns)
        self.beside, s.beside, s.role = None, None, ""
        s.rolled_back = f"taken out of shadow, {gone}: {late}"
        return s.rolled_back

    def _late_words(self, late_ns: list[int]) -> str:
        return (
            f"{len(late_ns)} answers within {LATE_WITHIN_NS * 1e-9:g} s took longer than "
            f"models.deadline_ms = {self._config.models.deadline_ms:g}"
        )

    def _cause(self, watched: bool) -> str:
        """Why the promoted set must go; empty: it need not."""
        s, settings = self.state, self._config.models
        if s.refused >= (1 if watched else REFUSED_MOST):
            return "an answer was not finite" + (" and the former set's was" if watched else "")
        if len(s.late_ns) >= LATE_MOST:
            return self._late_words(s.late_ns)
        share, what = self._comparison.disagreement() if watched else (0.0, "")
        if share > settings.disagreement_max:
            return (
                f"{what} differ from the former set's in {100 * share:.0f} % of "
                f"{settings.disagreement_decisions} decisions, models.disagreement_max is "
                f"{100 * settings.disagreement_max:.0f} %"
            )
        return ""

    def _back(self, cause: str) -> str:
        """Put the former set back by itself; the cause as people read it."""
        gone = " + ".join(self.state.active)
        try:
            self._exchange_back()
        except (ModelError, SetError) as error:
            cause = f"{cause}; the former set cannot come back: {error}"
            self.state.former = None
        else:
            cause = f"rolled back from {gone}: {cause}"
        self.state.rolled_back = cause
        return cause

    # ------------------------------------------------------------------ commands

    def obey(self, request: CommandRequest) -> CommandReply:
        """Carry out a person's wish about the models, or refuse it with every reason."""
        try:
            self._carry_out(request)
        except (ModelError, SetError) as error:
            return CommandReply(request.seq, False, str(error).splitlines())
        return CommandReply(request.seq, True, [])

    def _carry_out(self, request: CommandRequest) -> None:
        why = monitor_only(self._config.machine)
        if why:
            raise SetError(f"models: monitor only: {why[0]}; no set of models is used")
        if request.action == "add":
            self._line([*self.state.active, request.target])
        elif request.action == "shadow":
            self._shadow(request.target)
        elif request.action == "promote":
            self._promote(request.target)
        elif request.action == "rollback":
            if self.state.former is None:
                raise SetError("rollback: nothing was promoted that could be taken back")
            self._exchange_back()
            self.state.rolled_back = ""
        else:
            raise SetError(f"models: {request.action!r} is unknown")

    def _shadow(self, target: str) -> None:
        s = self.state
        layers = [*(each for each in s.active if each != target), target] if target else None
        self.beside = self._line(layers) if layers is not None else None
        s.beside, s.role, s.rolled_back = layers, "shadow" if target else "", ""
        self._begin()

    def _promote(self, target: str) -> None:
        s = self.state
        if s.role != "shadow" or self.beside is None or s.beside is None:
            raise SetError("promote: no set is in shadow; `orbitd models shadow SET` comes first")
        if target and s.beside[-1] != target:
            raise SetError(f"promote: {s.beside[-1]} is in shadow, not {target}")
        if self.active.commissioner.gathering:
            raise SetError(
                "promote: commissioning gathers decisions of the active classifier; `orbitd "
                "commission stop` or `cancel` comes first"
            )
        s.former, s.rolled_back = s.active, ""
        self._exchange(self.beside, s.beside)
        s.beside, s.role = s.former, "former"

    def _exchange_back(self) -> None:
        """The former set decides again, and nothing runs beside.

        Raises
        ------
        ModelError, SetError
            It was not running, and cannot be loaded.
        """
        s = self.state
        former = s.former or []
        line = self.beside if s.role == "former" and self.beside else self._line(former)
        self._exchange(line, former)
        self.beside, s.beside, s.role, s.former = None, None, "", None

    def _exchange(self, line: Line, layers: list[str]) -> None:
        """``line`` decides from now on; the other one runs beside.  Numbers of diagnoses go on."""
        seq = max(line.diagnoser.state.seq, self.active.diagnoser.state.seq)
        line.diagnoser.state.seq = seq
        if self.active.commissioner.gathering:  # by itself, in the middle of it
            self.active.commissioner.obey(CommandRequest(0, "commission", action="cancel"))
        self.active, self.beside = line, self.active
        self.state.active = layers
        self._begin()

    def _begin(self) -> None:
        """Compare anew."""
        self._comparison.state = ComparisonState()
        self.state.late_ns, self.state.beside_late_ns, self.state.refused = [], [], 0

    def _line(self, layers: Sequence[str]) -> Line:
        """A line of the models in ``layers``."""
        if self._library is None:
            raise SetError("models: this device has no shelf of models")
        return Line(self._library.load(layers), self._config)


def _newest(times_ns: list[int], more: int, now_ns: int) -> list[int]:
    """``times_ns`` within :data:`LATE_WITHIN_NS`, with ``more`` of now."""
    every = times_ns + [now_ns] * max(0, more)
    return [t_ns for t_ns in every if now_ns - t_ns < LATE_WITHIN_NS]


def named(layers: Sequence[str]) -> str:
    """``layers`` in a few words, different for different ones."""
    whole = "+".join(layers)
    if len(layers) <= NAMED_MOST:
        return whole
    digest = hashlib.sha256(whole.encode()).hexdigest()[:12]
    return f"{layers[-1]} on {len(layers) - 1} others ({digest})"

"""The brain's half of a replay: the recorded steps again, every diagnosis, forecast and advice
compared.

A segment starts at a snapshot of the brain whose samples the replayed guard has given, and lasts
while step follows step and all that a step took in is there.  Blocks, readings and states are the
replayed guard's; a record that the guard sent and the brain never got is left out here too,
counted.  Where the CPU has other features than the recording's, records agree within the
tolerances of :mod:`firmware_py.replay.compare`, and the brain is restored at each snapshot.
"""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Sequence
from typing import Any, Final

import msgspec

from firmware_py.brain import tree
from firmware_py.brain.core import BrainCore, BrainTree
from firmware_py.brain.errors import ModelError
from firmware_py.brain.store import Models
from firmware_py.brain.succession import Library
from firmware_py.config import Config
from firmware_py.model_sets.errors import SetError
from firmware_py.recording import TOPICS, RecordingError
from firmware_py.records import (
    Block,
    BrainSnapshot,
    CommandReply,
    Diagnosis,
    PeerRecord,
    Record,
)
from firmware_py.replay.compare import CLOSE, close, fields, plain, where
from firmware_py.replay.decisions import Replayed
from firmware_py.replay.diagnoses import DiagnosisReport
from firmware_py.replay.taken import OUTPUTS, RecordedStep
from firmware_py.routing import Stage, put_out, receivers

HISTORY_NS: Final = 4_000_000_000
"""Blocks this old are remembered: a snapshot looks back at the longest window."""
LATE_NS: Final = 500_000_000
"""A step comes before the cycles that it took from by no more than this in a recording."""
_DIAGNOSIS: Final = TOPICS[Diagnosis].name
_REPLY: Final = TOPICS[CommandReply].name


class BrainReport(msgspec.Struct):
    """What came of the comparison; ``first_difference`` is empty or names the record.

    ``recorded`` and ``compared`` count outputs by topic; ``outputs_missing`` are those that the
    recording lacks; ``records_lost`` were sent by the guard and never taken; ``steps_set_aside``
    lie outside segments.
    """

    segments: int = 0
    steps: int = 0
    steps_set_aside: int = 0
    recorded: dict[str, int] = {}
    compared: dict[str, int] = {}
    different: int = 0
    outputs_missing: int = 0
    records_lost: int = 0
    snapshots_compared: int = 0
    snapshots_different: int = 0
    exact: bool = True
    first_difference: str = ""
    models_missing: str = ""
    """Which set of models is not here, so that what it did could not be replayed."""
    diagnoses: DiagnosisReport = msgspec.field(default_factory=DiagnosisReport)
    """The diagnoses among all that."""

    @property
    def ok(self) -> bool:
        """All that could be compared agreed."""
        return not self.different and not self.snapshots_different


class _NotingLibrary:
    """The sets of ``library``; ``missing`` says which one could not be had."""

    def __init__(self, library: Library) -> None:
        self._library = library
        self.missing = ""

    def load(self, layers: Sequence[str]) -> Models:
        """See :class:`~firmware_py.brain.succession.Library`."""
        try:
            return self._library.load(layers)
        except (ModelError, SetError) as error:
            self.missing = str(error)
            raise


class BrainReplay:
    """Replays the brain of one recording.

    Parameters
    ----------
    steps
        What the recording holds (:func:`firmware_py.replay.taken.read_steps`).
    config
        The recorded configuration.
    models
        The same model files as then.
    cpu_features
        Of this machine: bit-exact where the recording has the same.
    library
        The sets that came into use on the way; None: there were none.
    """

    def __init__(
        self,
        steps: Sequence[RecordedStep],
        config: Config,
        models: Models,
        cpu_features: str,
        library: Library | None = None,
    ) -> None:
        self._config, self._models, self._cpu_features = config, models, cpu_features
        self._library = _NotingLibrary(library) if library else None
        self._due = deque(steps)
        told = Counter(message.topic for step in steps for message in step.outputs)
        self.report = BrainReport(recorded=dict(told))
        self.report.exact = all(
            part.cpu_features == cpu_features for step in steps for part in step.snapshot
        )
        self._core: BrainCore | None = None
        self._next_seq = 0
        self._blocks: deque[Block] = deque()
        self._sent: deque[PeerRecord] = deque()

    def step(self, cycle: Replayed) -> None:
        """Take what the guard gave the brain in one cycle, and do every step that this allows."""
        now_ns = cycle.cycle.now_ns
        if cycle.new_segment:
            self._do_steps(now_ns, now_ns)
            self._core = None
            self._blocks.clear()
            self._sent.clear()
        if cycle.cycle.brain_connected:
            sent = put_out(cycle.cycle, cycle.decision)
            self._sent += [record for record in sent if _to_brain(record)]
        elif self._sent:  # what was on its way to a brain that has gone
            self._do_steps(now_ns, now_ns)
            self._sent.clear()
        self._blocks += cycle.decision.blocks
        while self._blocks and now_ns - self._blocks[0].t_acq_ns > HISTORY_NS:
            self._blocks.popleft()
        self._do_steps(now_ns, now_ns - LATE_NS)

    def finish(self) -> BrainReport:
        """The report, after the last cycle."""
        end_ns = 1 << 63
        self._do_steps(end_ns, end_ns)
        of_diagnoses = self.report.diagnoses
        of_diagnoses.exact = self.report.exact
        of_diagnoses.recorded = self.report.recorded.get(_DIAGNOSIS, 0)
        of_diagnoses.compared = self.report.compared.get(_DIAGNOSIS, 0)
        of_diagnoses.set_aside = of_diagnoses.recorded - of_diagnoses.compared
        return self.report

    def _do_steps(self, until_ns: int, decided_ns: int) -> None:
        """Do the steps up to ``until_ns``; of those before ``decided_ns`` nothing more can come."""
        while self._due and self._due[0].step.now_ns <= until_ns:
            step = self._due[0]
            records = self._inputs(step)
            if records is None and step.step.now_ns >= decided_ns:
                return
            self._due.popleft()
            self._do(step, records)

    def _inputs(self, recorded: RecordedStep) -> list[PeerRecord] | None:
        """All that the step took, in its order; None while a part of it is not there.

        What the guard sent before the last of them and is none of them was lost.
        """
        wanted, found, passed = recorded.wanted, list[PeerRecord](), 0
        for record in self._sent:
            if len(found) == wanted:
                break
            passed += 1
            if record.seq in recorded.numbers[type(record)]:  # type: ignore[union-attr]
                found.append(record)
        gate = [*recorded.requests, *recorded.normals]
        if len(found) < wanted or None in gate:
            return None
        if self._core is not None:
            self.report.records_lost += passed - wanted
        for _ in range(passed):
            self._sent.popleft()
        return [*(record for record in gate if record is not None), *found]

    def _do(self, recorded: RecordedStep, records: list[PeerRecord] | None) -> None:
        step, report = recorded.step, self.report
        if self._core is not None and step.seq != self._next_seq:
            self._core = None
        self._next_seq = step.seq + 1
        snapshot = recorded.snapshot
        if snapshot and self._core is not None and report.exact:
            self._compare_state(self._core, snapshot)
        elif snapshot:
            self._core = self._restored(snapshot)
        if self._core is None or records is None:
            self._core = None
            report.steps_set_aside += 1
            return
        late = (step.late[0], step.late[1]) if step.late else (0, 0)
        said = self._core.step(records, step.now_ns, late)
        if self._library and self._library.missing and self._answers_otherwise(recorded, said):
            report.models_missing = report.models_missing or self._library.missing
            report.steps_set_aside += 1
            self._core = None
            return
        report.steps += 1
        self._compare(recorded, said)

    def _answers_otherwise(self, recorded: RecordedStep, said: list[PeerRecord]) -> bool:
        """Whether a command is answered otherwise than then."""
        ours = {_key(record): plain(record) for record in said if isinstance(record, CommandReply)}
        told = [m for m in recorded.outputs if m.topic == _REPLY]
        return any(ours.get((m.topic, fields(m).get("seq", 0))) != fields(m) for m in told)

    def _restored(self, snapshot: list[BrainSnapshot]) -> BrainCore | None:
        """The brain at ``snapshot``; None where not all of it, or of its samples, is there."""
        first, last = snapshot[0].first_block, snapshot[0].last_block
        blocks = [block for block in self._blocks if first <= block.seq <= last]
        if len(blocks) != last - first + 1 or len(snapshot) != snapshot[0].parts:
            return None
        core = BrainCore(self._config, self._models, self._cpu_features, library=self._library)
        try:
            core.restore(snapshot, blocks)
        except msgspec.DecodeError as error:
            raise RecordingError(
                f"the brain's state before step {snapshot[0].seq} does not fit this version "
                f"({error}); use the orbitd that wrote it"
            ) from error
        except (ModelError, SetError) as error:
            self.report.models_missing = self.report.models_missing or str(error)
            return None
        except ValueError:  # this time the guard made fewer samples of its frames
            return None
        self.report.segments += 1
        return core

    def _compare_state(self, core: BrainCore, snapshot: list[BrainSnapshot]) -> None:
        if len(snapshot) != snapshot[0].parts:
            return
        ours = core.snapshot(snapshot[0].seq, snapshot[0].now_ns)
        self.report.snapshots_compared += 1
        told, found = _as_read(snapshot), _as_read(ours)
        if told != found:
            self.report.snapshots_different += 1
            text = where(msgspec.msgpack.decode(told), msgspec.msgpack.decode(found))
            self._note(f"state of the brain before step {snapshot[0].seq}: {text}")

    def _compare(self, recorded: RecordedStep, said: list[PeerRecord]) -> None:
        """Hold every recorded output against the replayed one of the same topic and number."""
        ours = {_key(record): record for record in said if isinstance(record, OUTPUTS)}
        kinds = {TOPICS[kind].name for kind in (OUTPUTS if self.report.exact else CLOSE)}
        found = 0
        for message in recorded.outputs:
            told = fields(message)
            record = ours.get((message.topic, told.get("seq", 0)))
            found += record is not None
            if message.topic in kinds and (record is not None or recorded.followed):
                self._hold(message.topic, told, plain(record) if record is not None else {})
        self.report.outputs_missing += len(ours) - found

    def _hold(self, topic: str, told: dict[str, Any], found: dict[str, Any]) -> None:
        report = self.report
        report.compared[topic] = report.compared.get(topic, 0) + 1
        if told == found or (not report.exact and found and close(topic, told, found)):
            return
        report.different += 1
        text = f"{topic} {told.get('seq')}: {where(told, found)}"
        self._note(text)
        if topic == _DIAGNOSIS:
            report.diagnoses.different += 1
            report.diagnoses.first_difference = report.diagnoses.first_difference or text

    def _note(self, text: str) -> None:
        self.report.first_difference = self.report.first_difference or text


def _to_brain(record: PeerRecord) -> bool:
    return Stage.BRAIN in receivers(Stage.GUARD, record)


def _as_read(snapshot: Sequence[BrainSnapshot]) -> bytes:
    """A state as this version reads it: fields that are new since have their defaults."""
    return tree.encode(tree.decode(b"".join(part.state for part in snapshot), BrainTree))


def _key(record: Record) -> tuple[str, int]:
    return TOPICS[type(record)].name, record.seq  # type: ignore[attr-defined]

"""Replay of diagnoses alone, in a recording of before brains recorded their steps: the recorded
windows cut again from the replayed blocks, and diagnosed.

The brain stored the end of each window that it decided on; dropped windows are therefore left out
here too.  It also stored which normal state of the machine each decision was judged against, and
the recording holds that state.  A run of windows lies on a grid that starts ``MIN_SECONDS`` before
its first window's end, so the same windower, fed from that sample on, cuts the same windows.  Where
the recording begins in the middle of a run the first diagnoses rest on windows that nobody stored;
they are set aside, counted.
"""

from __future__ import annotations

from collections import defaultdict, deque
from typing import Any, Final

import msgspec

from firmware_py.acquire.channel_map import ChannelMap
from firmware_py.acquire.windows import MIN_SECONDS, Window, Windower
from firmware_py.brain.diagnosis import Diagnoser
from firmware_py.brain.normal import digest
from firmware_py.brain.prediction import slow_roll_forward
from firmware_py.brain.store import Models
from firmware_py.config import Config
from firmware_py.recording import TOPICS, Recording, RecordingError, Stored, decode_exact
from firmware_py.records import (
    Block,
    Diagnosis,
    Normal,
    RigReading,
    WindowRecord,
)
from firmware_py.replay.compare import same_diagnosis
from firmware_py.replay.decisions import Replayed

HISTORY_NS: Final = 3_000_000_000
"""Samples remembered here: the longest window and a hop, rounded up."""

SETTLED_AFTER_NS: Final = 8_000_000_000
"""From here on a recording that begins in mid-run holds all: two seconds of samples, six of
votes."""

_REACHING_BACK: Final = (
    "held_s",
    "confirmed",
    "shaft_1x_move_um",
    "shaft_1x_baseline_um",
    "shaft_1x_baseline_phase_deg",
)
"""Evidence that reaches back before the recording."""


class DiagnosisReport(msgspec.Struct):
    """What came of the comparison; ``first_difference`` is empty or names the diagnosis."""

    recorded: int = 0
    compared: int = 0
    set_aside: int = 0
    windows_not_found: int = 0
    different: int = 0
    exact: bool = True
    first_difference: str = ""

    @property
    def ok(self) -> bool:
        """All that could be compared agreed, and every window was found."""
        return not self.different and not self.windows_not_found


class DiagnosisReplay:
    """Replays the diagnoses of one recording.

    Parameters
    ----------
    recording
        For the stored windows and diagnoses (read once, at the start).
    config
        The recorded configuration.
    models
        The same model files as then.
    cpu_features
        Of this machine: bit-exact where the recording has the same.
    """

    def __init__(
        self, recording: Recording, config: Config, models: Models, cpu_features: str
    ) -> None:
        self.report = DiagnosisReport()
        self._config = config
        self._models = models
        self._rate_hz = config.sampling.rate_hz
        self._due: dict[int, list[tuple[WindowRecord, dict[str, Any]]]] = defaultdict(list)
        self._normals: dict[str, Normal | None] = {"": None}
        self._pair(recording, cpu_features)
        self._history: deque[Block | RigReading] = deque()
        self._restart()

    def _pair(self, recording: Recording, cpu_features: str) -> None:
        """Each stored window with its stored diagnosis, by the block that closed it; every normal
        state by its name."""
        told: dict[int, dict[str, Any]] = {}
        for message in recording.messages():
            if message.topic == TOPICS[Diagnosis].name:
                diagnosis = _decoded(message)
                told[diagnosis["seq"]] = diagnosis
            elif message.topic == TOPICS[Normal].name:
                normal = decode_exact(message, Normal)
                self._normals[digest(normal)] = normal
            elif message.topic == TOPICS[WindowRecord].name:
                window = decode_exact(message, WindowRecord)
                paired = told.get(window.diagnosis_seq)
                if paired is not None and paired["t_acq_ns"] == window.last_t_acq_ns:
                    self._due[window.last_block_seq].append(
                        (window, told.pop(window.diagnosis_seq))
                    )
                    self.report.recorded += 1
                    self.report.exact &= window.cpu_features == cpu_features

    def step(self, cycle: Replayed) -> None:
        """Take what the guard gave the brain in one cycle."""
        decision = cycle.decision
        if cycle.new_segment:
            self._restart()
        for block in decision.blocks:
            self._remember(block)
            windows = self._windower.step(block) if self._windower else []
            for record, told in self._due.get(block.seq, ()):
                if 0 < record.last_t_acq_ns - block.t_acq_ns <= block.instants * block.period_ns:
                    self._judge(record, told, block, windows)
        for reading in decision.readings:
            self._remember(reading)
            if self._windower:
                self._windower.note(reading)

    def finish(self) -> DiagnosisReport:
        """The report; what fell between segments is set aside."""
        report = self.report
        report.set_aside = report.recorded - report.compared - report.windows_not_found
        return report

    def _restart(self) -> None:
        """Nothing before now is known: another segment."""
        self._history.clear()
        self._windower: Windower | None = None
        self._diagnoser: Diagnoser | None = None
        self._exact_from_ns = 0
        self._whole = False

    def _remember(self, item: Block | RigReading) -> None:
        self._history.append(item)
        while self._history[-1].t_acq_ns - self._history[0].t_acq_ns > HISTORY_NS:
            self._history.popleft()

    def _judge(
        self, record: WindowRecord, told: dict[str, Any], block: Block, windows: list[Window]
    ) -> None:
        """Find the window of ``record``, diagnose it and compare with ``told``."""
        first = told["seq"] == 1
        found = [window for window in windows if window.end_ns == record.last_t_acq_ns]
        if first or not found:
            windows = self._begin_run(record, block, first)
            found = [window for window in windows if window.end_ns == record.last_t_acq_ns]
        known = record.normal in self._normals
        if self._diagnoser and self._diagnoser.normal_name != record.normal:
            self._diagnoser.use(self._normals.get(record.normal))
        diagnosis = self._diagnoser.step(found[0])[0] if found and self._diagnoser else None
        self._whole &= known
        if record.last_t_acq_ns < self._exact_from_ns or not known:
            return
        if diagnosis is None:
            self.report.windows_not_found += 1
            return
        self.report.compared += 1
        self._compare(told, msgspec.json.decode(msgspec.json.encode(diagnosis)))

    def _begin_run(self, record: WindowRecord, block: Block, first: bool) -> list[Window]:
        """A windower whose grid fits ``record``, fed with what is remembered; its last windows."""
        period_us = block.sample_period_us
        end_us = (
            block.tick_us
            + round((record.last_t_acq_ns - block.t_acq_ns) / block.period_ns) * period_us
        )
        start_us = end_us - round(MIN_SECONDS * self._rate_hz) * period_us
        oldest_us = next(item.tick_us for item in self._history if isinstance(item, Block))
        if first or self._diagnoser is None:
            self._diagnoser = Diagnoser(
                self._models.classifier, self._config.machine, slow_roll_forward(self._config)
            )
            self._whole = first and start_us >= oldest_us
            self._exact_from_ns = 0 if self._whole else block.t_acq_ns + SETTLED_AFTER_NS
        self._windower = Windower(ChannelMap.from_config(self._config), self._rate_hz)
        return self._feed_from(self._windower, start_us)

    def _feed_from(self, windower: Windower, start_us: int) -> list[Window]:
        windows: list[Window] = []
        begun = False
        for item in self._history:
            if (
                isinstance(item, Block)
                and item.tick_us + item.instants * item.sample_period_us > start_us
            ):
                windows = windower.step(item if begun else _from_tick(item, start_us))
                begun = True
            elif isinstance(item, RigReading) and begun:
                windower.note(item)
        return windows

    def _compare(self, told: dict[str, Any], found: dict[str, Any]) -> None:
        for each in (told, found):
            each.pop("seq")
            for name in () if self._whole else _REACHING_BACK:
                each["evidence"].pop(name, None)
        same = told == found if self.report.exact else same_diagnosis(told, found)
        if not same:
            self.report.different += 1
            self.report.first_difference = (
                self.report.first_difference or f"recorded {told}, replayed {found}"
            )


def _decoded(message: Stored) -> dict[str, Any]:
    """A stored diagnosis as plain fields: its numbers are compared as they were written, nan as
    null."""
    try:
        fields: dict[str, Any] = msgspec.json.decode(message.data, type=dict[str, Any])
        return fields if {"seq", "t_acq_ns"} <= fields.keys() else {"seq": 0, "t_acq_ns": 0}
    except (msgspec.DecodeError, UnicodeDecodeError) as error:
        raise RecordingError(
            f"a diagnosis in the recording is no JSON of this version ({error})"
        ) from error


def _from_tick(block: Block, start_us: int) -> Block:
    """``block`` without the rows before the node tick ``start_us``."""
    skip = max(0, (start_us - block.tick_us) // block.sample_period_us)
    return msgspec.structs.replace(
        block,
        samples=block.samples[2 * block.channels * skip :],
        t_acq_ns=block.t_acq_ns + skip * block.period_ns,
        tick_us=block.tick_us + skip * block.sample_period_us,
    )

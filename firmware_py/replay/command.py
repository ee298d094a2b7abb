"""``orbitd replay FILE``: run a recording again and compare every decision, and all that the brain
said."""

from __future__ import annotations

import argparse
import json
import os
from pathlib import Path
from typing import Any

import msgspec

from firmware_py import launch
from firmware_py.brain.library import ShelfLibrary
from firmware_py.brain.loop import cpu_features
from firmware_py.brain.store import load_models
from firmware_py.config import Config, ConfigError, decode
from firmware_py.gate.loop import read_models
from firmware_py.recording import Recording, RecordingError
from firmware_py.replay.brain import BrainReplay, BrainReport
from firmware_py.replay.decisions import DecisionReplay, DecisionReport
from firmware_py.replay.diagnoses import DiagnosisReplay, DiagnosisReport
from firmware_py.replay.taken import read_steps


class Report(msgspec.Struct):
    """Outcome of one replay (``--json``)."""

    file: str
    ok: bool
    interrupted: bool
    seconds: float
    decisions: DecisionReport
    diagnoses: DiagnosisReport | None
    diagnoses_left_out: str
    brain: BrainReport | None = None
    """Of a recording that holds the steps of the brain."""
    skipped_bytes: int = 0
    damage: list[str] = msgspec.field(default_factory=list)


def main(argv: list[str]) -> int:
    """Replay the file; 0 when all that is whole agreed, 1 when not, 2 when nothing in it can be
    replayed."""
    parser = argparse.ArgumentParser(prog="orbitd replay", description=__doc__)
    parser.add_argument("file", type=Path, help="MCAP file of the flight recorder")
    parser.add_argument("--json", action="store_true", help="the report as JSON")
    options = parser.parse_args(argv)
    report = replay(options.file)
    print(msgspec.json.encode(report).decode() if options.json else "\n".join(words(report)))
    return 0 if report.ok else 1


def replay(path: Path) -> Report:
    """Replay ``path``.

    Raises
    ------
    RecordingError
        It is no recording, nothing in it can be replayed, or this version does not know its
        configuration or records.
    """
    recording = Recording(path)
    config = _config(recording)
    left_out = _why_no_diagnoses(recording, config)
    decisions = DecisionReplay(config)
    brain = None if left_out else _brain(recording, config)
    first_ns = last_ns = 0
    for cycle in decisions.run(recording):
        first_ns, last_ns = first_ns or cycle.cycle.now_ns, cycle.cycle.now_ns
        if brain:
            brain.step(cycle)
    damage = recording.damage
    if not decisions.report.cycles:
        raise RecordingError("; ".join([_why_nothing(path, decisions.report), *damage.notes]))
    found = brain.finish() if brain else None
    judged = found.diagnoses if isinstance(found, BrainReport) else found
    return Report(
        file=path.name,
        ok=decisions.report.ok and (found is None or found.ok),
        interrupted=recording.interrupted,
        seconds=(last_ns - first_ns) * 1e-9,
        decisions=decisions.report,
        diagnoses=judged,
        diagnoses_left_out=left_out,
        brain=found if isinstance(found, BrainReport) else None,
        skipped_bytes=damage.skipped_bytes,
        damage=damage.notes,
    )


def _brain(recording: Recording, config: Config) -> BrainReplay | DiagnosisReplay:
    """Of all that the brain said; of its diagnoses where the recording does not hold its steps."""
    models, steps = load_models(config), read_steps(recording)
    if steps:
        state = launch.state_dir(config, os.environ)
        library = ShelfLibrary(config, launch.shelf_folder(config, state))
        return BrainReplay(steps, config, models, cpu_features(), library)
    return DiagnosisReplay(recording, config, models, cpu_features())


def _why_nothing(path: Path, report: DecisionReport) -> str:
    if report.cycles_outside_segments:
        return (
            f"{path.name}: none of its {report.cycles_outside_segments} guard cycles follows a "
            f"snapshot of the "
            "guard; use a longer recording, there is a snapshot every second"
        )
    return (
        f"{path.name}: no guard cycle is in it: recorder.raw_frames was off, the guard did not "
        f"run, or the file "
        "ends before; use another recording"
    )


def _config(recording: Recording) -> Config:
    try:
        return decode(recording.metadata["config"], recording.path)
    except (KeyError, ConfigError) as error:
        raise RecordingError(
            f"{recording.path.name}: its configuration does not fit this version ({error}); use "
            f"orbitd {recording.metadata.get('orbitd')} that wrote it"
        ) from error


def _why_no_diagnoses(recording: Recording, config: Config) -> str:
    """Empty when the model files here are those of the recording."""
    try:
        same = json.loads(recording.metadata.get("models", "{}")) == read_models(config)
    except ValueError:
        same = False
    return "" if same else "the model files here are not those of the recording"


def words(report: Report) -> list[str]:
    """The report for a person."""
    d = report.decisions
    lines = [
        f"{report.file}: {report.seconds:.1f} s{', interrupted' if report.interrupted else ''}",
        f"decisions   {d.cycles} cycles in {d.segments} segments, {d.different} different; "
        f"{d.snapshots_compared} states compared, {d.snapshots_different} different; "
        f"{d.cycles_missing} cycles missing, {d.cycles_outside_segments} outside segments",
    ]
    lines.append(
        _diagnosis_words(report.diagnoses)
        if report.diagnoses
        else f"diagnoses   not compared: {report.diagnoses_left_out}"
    )
    if report.brain:
        lines.append(_brain_words(report.brain))
    judged = report.brain or report.diagnoses
    firsts: list[Any] = [d.first_difference, judged.first_difference if judged else ""]
    if report.brain and report.brain.models_missing:
        lines.append(f"models      not all replayed: {report.brain.models_missing}")
    lines += [f"damage      {note}" for note in report.damage]
    return [
        *lines,
        *(f"first difference: {text}" for text in firsts if text),
        f"same decisions{_what_else(report)}" if report.ok else "NOT the same",
    ]


def _what_else(report: Report) -> str:
    if report.brain:
        return ", diagnoses, forecasts and advice"
    return " and diagnoses" if report.diagnoses else ""


def _brain_words(report: BrainReport) -> str:
    counts = ", ".join(f"{count} {topic}" for topic, count in sorted(report.compared.items()))
    return (
        f"brain       {report.steps} steps in {report.segments} segments, compared: {counts}; "
        f"{report.different} different; {report.snapshots_compared} states compared, "
        f"{report.snapshots_different} different; {report.steps_set_aside} steps set aside, "
        f"{report.records_lost} records lost on their way to it, {report.outputs_missing} outputs "
        f"not in the recording"
    )


def _diagnosis_words(report: DiagnosisReport) -> str:
    how = "bit by bit" if report.exact else "verdict and probability (other CPU features)"
    return (
        f"diagnoses   {report.compared} of {report.recorded} compared {how}, {report.different} "
        f"different, "
        f"{report.windows_not_found} windows not found, {report.set_aside} set aside"
    )

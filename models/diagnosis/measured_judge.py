"""``orbitd evaluate classifier --data DIR --file MODEL``: a model trained elsewhere, on recordings
that it has not seen, by the words that the device would say."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from firmware_py.brain.errors import ModelError
from firmware_py.brain.own_card import KIND, OwnOptions
from firmware_py.brain.session import Session
from firmware_py.brain.shadow import decide
from firmware_py.brain.store import Card, read_card
from firmware_py.brain.verdict import WINDOWS
from models.diagnosis import measured
from models.diagnosis.dataset import DatasetError
from models.diagnosis.dataset_folder import NORMAL, MeasuredRecording, listed
from models.diagnosis.measured_features import FeatureRows, windows_of


def judge(path: Path, found: Sequence[MeasuredRecording], seed: int) -> dict[str, object]:
    """Windows and decisions of recordings that the model was not trained on, beside a forest that
    is trained here with groups left out.

    Raises
    ------
    DatasetError
        The file is no model of one's own recordings, or these recordings are not like those that it
        was trained on: everything that differs.
    """
    card, options, session = load(path)
    alike = fitting(path.name, card, options, found)
    seen = [each.name for each in alike if each.fingerprint in options.recordings]
    unseen = [each for each in alike if each.fingerprint not in options.recordings]
    if not unseen:
        raise DatasetError(
            f"{path.name}: was trained on all {len(seen)} recordings; give others, or judge by "
            "groups left out: evaluate without --file"
        )
    views = tuple({options.view, measured.FOREST[0]})
    data = windows_of(unseen, options.window_s, views)
    if options.view not in data.views:
        raise DatasetError(
            f"{path.name}: needs {options.view}: {dict(data.left_out).get(options.view)}"
        )
    answers = session.run(data.views[options.view])
    report: dict[str, object] = {
        "file": path.name,
        "view": options.view,
        "labels": list(options.labels),
        "recordings": len(unseen),
        "recordings_seen_in_training": len(seen),
        "windows": len(data),
        "majority_share": round(float(np.bincount(data.label).max() / len(data)), 4),
        "per_window": _figures(data, _words(options, answers, 1, data), options.labels),
        "per_decision": _figures(data, _words(options, answers, WINDOWS, data), options.labels),
    }
    return report | {"beside": _beside(data, seed)}


def load(path: Path) -> tuple[Card, OwnOptions, Session]:
    """Card, its settings and session of a model of one's own recordings.

    Raises
    ------
    DatasetError
        It cannot be read, or is another kind of model.
    """
    try:
        session = Session(path.name, path.read_bytes())
        card = read_card(path.name, session.metadata)
    except (OSError, ModelError) as error:
        raise DatasetError(f"{path}: cannot be judged: {error}") from error
    if card.kind != KIND:
        raise DatasetError(
            f"{path}: a {card.kind}, not a {KIND}: its features are those of its own rig; train "
            "one with `orbitd train classifier --data`, or judge this one without --data"
        )
    try:
        return card, OwnOptions.of(card.settings), session
    except ValueError as error:
        raise DatasetError(f"{path}: {error}; train it again with this version") from error


def fitting(
    name: str, card: Card, options: OwnOptions, found: Sequence[MeasuredRecording]
) -> list[MeasuredRecording]:
    """``found`` with the model's channels in its order.

    Raises
    ------
    DatasetError
        Channels, units or rate differ from those of the training.
    """
    problems, fitted = [], []
    for each in found:
        missing = [channel for channel in card.channels if channel not in each.channels]
        if missing:
            problems.append(
                f"{each.name}: lacks the channels {', '.join(missing)} of {name}, it has "
                f"{', '.join(each.channels)}; name them alike in channels.toml"
            )
            continue
        at = [each.channels.index(channel) for channel in card.channels]
        units = tuple(each.units[i] for i in at) if each.units else ()
        if units != tuple(card.units):
            problems.append(
                f"{each.name}: units {units}, {name} was trained with {tuple(card.units)}; say the "
                "units in channels.toml"
            )
        if abs(each.rate_hz - options.rate_hz) > 1e-3 * options.rate_hz:
            problems.append(
                f"{each.name}: {each.rate_hz:g} Hz, {name} was trained at {options.rate_hz:g}; say "
                f"resample_hz = {options.rate_hz:g} under [file] in channels.toml"
            )
        fitted.append(
            replace(
                each,
                samples=np.ascontiguousarray(each.samples[:, at]),
                channels=tuple(card.channels),
                units=units,
            )
        )
    if problems:
        raise DatasetError(listed(problems))
    return fitted


def _words(
    options: OwnOptions,
    answers: dict[str, measured.Floats],
    windows: int,
    data: FeatureRows,
) -> list[tuple[int, str]]:
    """First row and word of every decision of so many windows of one recording."""
    said = []
    for recording in np.unique(data.recording):
        rows = np.flatnonzero(data.recording == recording)
        for start in range(0, max(1, len(rows) - windows + 1), windows):
            part = rows[start : start + windows]
            decision = decide(options.labels, answers["classes"][part], answers["score"][part, 0])
            said.append((int(part[0]), decision.verdict))
    return said


def _figures(
    data: FeatureRows, said: Sequence[tuple[int, str]], labels: Sequence[str]
) -> dict[str, object]:
    """How often each true label was given each word, and the mean recall of the labels that the
    model knows."""
    told: dict[str, dict[str, int]] = {}
    for row, word in said:
        of = told.setdefault(data.labels[data.label[row]], {})
        of[word] = of.get(word, 0) + 1
    known = {
        label: of.get(label, 0) / sum(of.values()) for label, of in told.items() if label in labels
    }
    strange = {
        label: of.get("unknown", 0) / sum(of.values())
        for label, of in told.items()
        if label not in labels
    }
    found: dict[str, object] = {"decisions": len(said), "words": told}
    if known:
        found["balanced_accuracy"] = round(float(np.mean(list(known.values()))), 4)
    if strange:
        found["unknown_found"] = {label: round(share, 4) for label, share in strange.items()}
    if NORMAL in told:
        healthy = told[NORMAL]
        wrong = sum(n for word, n in healthy.items() if word not in (NORMAL, "doubt"))
        found["false_alarms"] = round(wrong / sum(healthy.values()), 4)
    return found


def _beside(data: FeatureRows, seed: int) -> dict[str, object]:
    """A forest on log band energies, trained on these recordings with each group left out."""
    try:
        report = measured.evaluate(data, seed, {})
    except DatasetError as error:
        return {"left_out": str(error)}
    return {measured.FOREST_NAME: report[measured.FOREST_NAME]}

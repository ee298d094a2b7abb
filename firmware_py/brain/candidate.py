"""Whether a set of models may come onto the shelf of a device: read, whose, fitting, finite, fast.

The questions that are put to the models are points of the device's own machine, so that a model
that fits has an answer to each of them.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping
from pathlib import Path
from statistics import median
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from firmware_py.acquire.features import FEATURE_NAMES
from firmware_py.brain.errors import ModelAnswerError, ModelUnfitError
from firmware_py.brain.prediction import CANDIDATES
from firmware_py.brain.session import Session
from firmware_py.brain.store import Model, Models, load_models, read_card
from firmware_py.brain.trust import read_bytes
from firmware_py.config import Config
from firmware_py.machine.lubricant import viscosity_Pa_s
from firmware_py.machine.parts import monitor_only
from firmware_py.model_sets.errors import SetError
from firmware_py.model_sets.manifest import (
    FACTORS,
    KINDS,
    MANIFEST,
    SIGNATURE,
    files_in,
    manifest_of,
    read_manifest,
)

ASKED: Final = 20
"""Answers of which the median is held against the deadline: a single one may be held up by the
computer."""
SIGMA_POINTS: Final = 7

_MODEL_OF: Final = {"classifier": "classifier", "actor": "actor", "surrogate": "surrogate",
                    "measured classifier": "shadow"}  # fmt: skip


def read_source(source: Path) -> dict[str, bytes]:
    """The files of a set that a person names: a folder with a set, or one model.

    A folder keeps its manifest and signatures; without a manifest one is written.

    Raises
    ------
    ModelError, SetError
        Nothing of it can be read, or it holds no model.
    """
    if source.is_dir():
        names = files_in(source)
        files = {name: read_bytes(source / name) for name in names}
        if not files:
            raise SetError(
                f"{source}: none of {', '.join(KINDS.values())} is in it; name a folder of models"
            )
        beside = [MANIFEST, SIGNATURE] if (source / MANIFEST).is_file() else []
        extra = {n: source / n for n in (*beside, *(f"{name}.sig" for name in names))}
    else:
        data = read_bytes(source)
        name = _file_name(source, data)
        files, extra = {name: data}, {f"{name}.sig": source.with_name(f"{source.name}.sig")}
    signed = {name: read_bytes(path) for name, path in extra.items() if path.is_file()}
    if MANIFEST in signed:
        listed = read_manifest(signed[MANIFEST], f"{source.name}/{MANIFEST}").files
        if left := [name for name in files if name not in listed]:
            raise SetError(
                f"{source}: {MANIFEST} does not name {', '.join(left)}; write it again with "
                "`orbitd keys sign`"
            )
        return files | signed
    return files | signed | {MANIFEST: manifest_of(files.items())}


def _file_name(source: Path, data: bytes) -> str:
    """Name under which the device loads a single model: by the kind in its card."""
    if source.suffix == ".json":
        return FACTORS
    card = read_card(source.name, Session(source.name, data).metadata)
    if card.kind not in KINDS:
        raise ModelUnfitError(
            f"{source.name}: kind {card.kind!r}, this device uses {', '.join(KINDS)}"
        )
    return KINDS[card.kind]


def examine(folder: Path, config: Config, layers: list[Path]) -> Models:
    """The models as they would be with the set in ``folder`` on top of ``layers``.

    Raises
    ------
    ModelUnfitError
        A file of the set is refused, answers something that is not finite, or too late; every
        reason at once.
    """
    models = load_models(config, [*layers, folder])
    kinds = [kind for kind, name in KINDS.items() if (folder / name).is_file()]
    wrong = [
        models.refusals[refused]
        for kind in kinds
        if (refused := _MODEL_OF.get(kind, kind)) in models.refusals
    ]
    if not set(kinds) - set(models.off):
        wrong += [f"{kind}: {models.off[kind]}" for kind in kinds if kind in models.off]
    for kind in kinds:
        model = getattr(models, _MODEL_OF[kind]) if kind in _MODEL_OF else None
        if model is not None:
            wrong += _answers(kind, model, config)
    if wrong:
        raise ModelUnfitError("\n".join(wrong))
    return models


def _answers(kind: str, model: Model, config: Config) -> Iterator[str]:
    """What is wrong with the answers of ``model``, if anything."""
    rows, took_s = questions(kind, model, config), []
    try:
        for _ in range(ASKED):
            start = time.perf_counter()
            model.session.run(rows)
            took_s.append(time.perf_counter() - start)
            if sum(took_s) > ASKED * 1e-3 * config.models.deadline_ms:
                break  # slower than all of them may be together
    except ModelAnswerError as error:
        yield str(error)
        return
    except Exception as error:  # noqa: BLE001 -- the errors of onnxruntime share no base
        first = str(error).splitlines()[0][:200]
        yield f"{model.session.name}: cannot answer ({first}); export it again"
        return
    if median(took_s) * 1e3 > config.models.deadline_ms:
        yield (
            f"{model.session.name}: answers {len(rows)} rows in {median(took_s) * 1e3:.1f} ms, "
            f"models.deadline_ms is {config.models.deadline_ms:g}; use a smaller model"
        )


def questions(kind: str, model: Model, config: Config) -> NDArray[np.float64]:
    """Rows to be put to a model of ``kind``, as many as the device puts to it at once."""
    if kind == "surrogate":
        return _film_states(config)
    if kind == "actor":
        return _observations(model.card.domain, model.card.inputs)
    columns = model.session.columns
    width = columns if isinstance(columns, int) else len(FEATURE_NAMES)
    return np.zeros((1, width))


def _film_states(config: Config) -> NDArray[np.float64]:
    """Journal at rest on half the clearance, over the ranges of speed and clearance."""
    b, o = config.machine.bearing, config.machine.operating
    n = (CANDIDATES + 1) * SIGMA_POINTS
    share = np.linspace(0.0, 1.0, n)
    least, most = b.radial_clearance_min_um, b.radial_clearance_max_um
    clearance_m = 1e-6 * (least + share * (most - least))
    speed = (o.speed_min_rpm + share * (o.speed_max_rpm - o.speed_min_rpm)) * np.pi / 30.0
    rows = np.zeros((n, 9))
    rows[:, 0], rows[:, 4], rows[:, 5] = 0.3 * clearance_m, speed, clearance_m
    rows[:, 1] = -0.4 * clearance_m
    rows[:, 6] = viscosity_Pa_s(config.machine.lubricant, 40.0)
    rows[:, 7], rows[:, 8] = b.journal_radius_m, b.length_m
    return rows


def _observations(
    domain: Mapping[str, tuple[float, float]], inputs: list[str]
) -> NDArray[np.float64]:
    """The middle of what the policy says that it knows."""
    middle: list[Any] = [0.5 * sum(domain.get(name, (0.0, 0.0))) for name in inputs]
    return np.array([middle], np.float64)


def check_useful(config: Config) -> None:
    """Refuse sets for a machine whose device thinks with none.

    Raises
    ------
    SetError
        The machine is monitor only.
    """
    why = monitor_only(config.machine)
    if why:
        raise SetError(
            f"monitor only: {why[0]}; such a machine is judged by its own normal state (`orbitd "
            "commission`), no set is used"
        )

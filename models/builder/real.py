"""Figures from recordings of the real machine, beside the simulated ones."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from models.builder import BuildError
from models.diagnosis import measured, measured_normal
from models.diagnosis.dataset import DatasetError
from models.diagnosis.dataset_folder import read_folder
from models.diagnosis.measured_features import windows_of
from models.diagnosis.real_figures import REAL_RECORDINGS

WINDOW_S = 1.0


def check_there(folder: Path) -> None:
    """Refuse what is no folder, which a build does before it spends an hour."""
    if not folder.is_dir():
        raise BuildError(f"--data {folder}: no such folder; see docs/recordings.md")


def real_figures(folder: Path, asked: bool, seed: int) -> dict[str, Any]:
    """What the method reaches on the recordings in ``folder``, each group left out in turn; without
    any, what it reaches on other people's machines.

    Raises
    ------
    BuildError
        The recordings that were asked for cannot be used.
    """
    others = {"of": "other people's machines", "figures": dict(REAL_RECORDINGS)}
    if asked:
        check_there(folder)
    elif not folder.is_dir():
        return others
    try:
        data = windows_of(read_folder(folder, "group", None), WINDOW_S)
        if len(data.labels) == 1:
            found: dict[str, object] = measured_normal.normal_only(data)
        else:
            found = {**measured.evaluate(data, seed), "fit_normal": measured_normal.detect(data)}
    except DatasetError as error:
        if asked:
            raise BuildError(f"--data {folder}: {error}") from error
        return {**others, "left_out": f"{folder.name}: {error}"}
    return {"of": f"this machine ({folder.name})", "figures": found}

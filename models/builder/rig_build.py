"""One build: its machine, what is done for it and what is left out, and what is kept of each stage.

Everything lies in ``FOLDER/build/SIZE-seedN-DIGEST``: an edited machine, other code or another seed
begins anew, and the same one goes on wherever it was interrupted.
"""

from __future__ import annotations

import fcntl
import hashlib
import json
import math
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import closing, contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from types import ModuleType
from typing import Any, Final

import msgspec
import numpy as np

from firmware_py.acquire.features import RATE_HZ
from firmware_py.config import Config
from firmware_py.machine.folder import SIMULATION
from firmware_py.machine.parts import monitor_only
from firmware_py.records import CHANNELS
from models import PHYSICS_VERSION
from models.builder import BuildError
from models.builder.sizes import Size, Sizes, sizes_of
from models.checkpoint import CheckpointError
from models.manifest import write_whole
from models.runs import TrainerSettings, TrainingRun
from models.workers import code_digest
from sim_hil.rigs import NotSimulated, RigData, load_rig

WORK: Final = "build"
Report = dict[str, Any]


class StageResult(msgspec.Struct, frozen=True):
    """What a stage leaves: figures for the report, and its files (paths below the work folder) by
    the names that the device loads."""

    report: dict[str, Any] = {}
    files: dict[str, str] = {}
    seconds: float = 0.0


@dataclass(frozen=True)
class RigBuild:
    """What is built, from what, where.

    Attributes
    ----------
    rig
        None: a machine that cannot be simulated.
    left_out
        Stages that the machine has no use for, or that cannot be done for it, with the reason.
    """

    folder: Path
    config: Config
    rig: RigData | None
    size: Size
    seed: int
    workers: int
    left_out: Mapping[str, str]

    @classmethod
    def of(cls, folder: Path, config: Config, size: Size, seed: int, workers: int) -> RigBuild:
        """What can be built for the machine in ``folder``."""
        try:
            rig, why = load_rig(folder), ""
        except NotSimulated as error:
            rig, why = None, str(error)
        if rig is not None and not (folder / SIMULATION).is_file():
            rig, why = None, f"no {SIMULATION}: nothing says how one example differs from another"
        return cls(folder, config, rig, size, seed, workers, _left_out(config, why))

    @property
    def sizes(self) -> Sizes:
        """Settings of the trainers."""
        return sizes_of(self.size)

    @property
    def command(self) -> str:
        """Line that makes the same again."""
        return f"orbitd build {self.folder.name} --size {self.size} --seed {self.seed}"

    @property
    def work(self) -> Path:
        """Where its stages keep what they have done."""
        rig = self.rig.digest if self.rig else ""
        rate = self.config.sampling.rate_hz
        trained = replace(self.sizes, sealed=False)
        told = repr((rig, rate, code_digest(), PHYSICS_VERSION, trained))
        digest = hashlib.sha256(told.encode()).hexdigest()[:12]
        return self.folder / WORK / f"{self.size}-seed{self.seed}-{digest}"

    def kept(self, stage: str, do: Callable[[], StageResult]) -> tuple[StageResult, bool]:
        """The result of ``stage``, done once, and whether it was there already."""
        path = self.work / f"{stage}.json"
        if path.is_file():
            return msgspec.json.decode(path.read_bytes(), type=StageResult), True
        started = time.monotonic()
        done = do()
        seconds = round(time.monotonic() - started, 1)
        done = StageResult(_finite(done.report), done.files, seconds)
        self.work.mkdir(parents=True, exist_ok=True)
        write_whole(path, (json.dumps(msgspec.to_builtins(done), indent=1) + "\n").encode())
        return done, False

    def train(self, kind: str, trainer: ModuleType, settings: TrainerSettings) -> Report:
        """Train ``kind`` in the work folder, going on where it was interrupted.

        Raises
        ------
        BuildError
            What lies there was made with other settings, or is damaged.
        """
        there = self.work / f"{kind}-seed{self.seed}" / "config.json"
        try:
            run = TrainingRun(
                self.work,
                kind,
                self.seed,
                settings,
                smoke=False,
                resume=there.is_file(),
                command=self.command,
                home=self.folder,
            )
        except ValueError as error:  # other settings, or no JSON
            raise BuildError(
                f"{there}: not of this build: made with other settings, or damaged; delete "
                f"{there.parent}, then the same command makes the {kind} anew"
            ) from error
        try:
            with closing(run):
                report: Report = trainer.train(run, settings)
        except CheckpointError as error:
            raise BuildError(f"{error}; then the same command goes on") from error
        return report

    def path(self, kind: str, name: str) -> str:
        """File ``name`` of the training of ``kind``, below the work folder."""
        return f"{kind}-seed{self.seed}/{name}"


def _finite(value: Any) -> Any:
    """``value`` as JSON has it: what is not a number is null there."""
    if isinstance(value, Mapping):
        return {str(key): _finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(item) for item in value]
    if isinstance(value, float | np.floating):
        return float(value) if math.isfinite(value) else None
    return value.item() if isinstance(value, np.generic) else value


@contextmanager
def alone(folder: Path) -> Iterator[None]:
    """No second build of ``folder`` runs meanwhile.

    Raises
    ------
    BuildError
        One does.
    """
    place = folder / WORK
    place.mkdir(exist_ok=True)
    with (place / ".lock").open("w") as lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            raise BuildError(
                f"{folder}: another build of this folder runs; wait for it, or end it first (it "
                "goes on from where it was)"
            ) from error
        yield


def _left_out(config: Config, not_simulated: str) -> dict[str, str]:
    """Why which stages are left out."""
    machine, rate = config.machine, config.sampling.rate_hz
    names = tuple(channel.name for channel in machine.channel)
    stages = ("film", "surrogate", "predictor", "classifier", "sensors", "policies", "sealed")
    if not_simulated:
        return dict.fromkeys(stages, f"not simulated: {not_simulated}")
    found = {}
    if rate % round(RATE_HZ):
        found["classifier"] = (
            f"sampling.rate_hz = {rate}: features are defined at multiples of {RATE_HZ:g} Hz; "
            "sample at one"
        )
    if machine.contact is None:
        found["classifier"] = "no [contact]: its features rest on a contact channel"
    if names != CHANNELS:
        found["classifier"] = "other channels than the standard ones, in their order"
    if "classifier" in found:
        found["sensors"] = "no classifier"
    if why := monitor_only(machine):
        found |= dict.fromkeys(("surrogate", "predictor", "policies"), f"monitor only: {why[0]}")
    return found

"""A build from its options to the set in the folder."""

from __future__ import annotations

import argparse
import os
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from functools import partial
from pathlib import Path

import torch
from rich.console import Console
from threadpoolctl import threadpool_limits

from firmware_py import config as configuration
from firmware_py.brain.store import load_models
from firmware_py.config import Config
from firmware_py.guard.envelope.carrying import check_carried
from firmware_py.guard.envelope.shield_check import check_safe
from firmware_py.machine.folder import own_set, shipped_names
from firmware_py.model_sets.manifest import KINDS
from models.builder import BuildError
from models.builder.finish import move_in
from models.builder.real import check_there, real_figures
from models.builder.report import report_of
from models.builder.rig_build import RigBuild, StageResult, alone
from models.builder.stages import STAGES, sealed
from models.workers import spread

REPORT = "report.html"


def build(options: argparse.Namespace) -> int:
    """Build as asked; returns the exit code.

    Raises
    ------
    BuildError, ConfigError
        The folder is none, is the package's, or has faults; no recordings are where they shall be.
    """
    folder, console = _folder(options.folder), Console(stderr=True)
    if options.data is not None:
        check_there(options.data)
    config, _ = configuration.load(folder, (check_carried, check_safe))
    made = RigBuild.of(folder, config, options.size, options.seed, options.workers)
    for reason in dict.fromkeys(made.left_out.values()):
        stages = ", ".join(stage for stage, why in made.left_out.items() if why == reason)
        console.print(f"left out {stages}: {reason}", markup=False, soft_wrap=True)
    if made.rig is None:
        console.print(_instead(config), markup=False, soft_wrap=True)
        return 0
    _keeps_what_passed(made)
    over = spread(options.spread, str(folder)) if options.spread else nullcontext(0)
    with alone(folder), one_thread(), over as helpers:
        if helpers:
            console.print(f"episodes over {helpers} workers of {options.spread}", markup=False)
        results = _staged(made, console)
    real = real_figures(options.data or folder / "recordings", options.data is not None, made.seed)
    files = {
        name: (made.work / path).read_bytes()
        for result in results.values()
        for name, path in result.files.items()
    }
    files[REPORT] = report_of(made, results, real).encode()
    there = move_in(folder, files)
    for line in summary(made, results, there):
        print(line)
    return 0


def _folder(named: Path) -> Path:
    if str(named) in shipped_names():
        raise BuildError(
            f"{named}: ships with its models; `orbitd rig new my_rig --from {named}` makes a "
            "folder to build" + (f" (./{named} is your folder)" if named.is_dir() else "")
        )
    if named.is_file():
        raise BuildError(f"{named}: a file; give its folder: `orbitd build {named.parent}`")
    if not named.is_dir():
        raise BuildError(f"{named}: no rig folder; `orbitd rig new {named}` makes one")
    if not os.access(named, os.W_OK):
        raise BuildError(f"{named}: cannot be written; build in a folder of your own")
    return named.resolve()


def _keeps_what_passed(made: RigBuild) -> None:
    """A trial is no successor of a set that passed its sealed test and fits the machine."""
    own = own_set(made.folder)
    if made.size != "trial" or own is None or made.config.models.directory != str(own):
        return
    models = load_models(made.config)
    if any(model and model.qualified for model in (models.classifier, models.actor)):
        raise BuildError(
            f"{own}: passed its sealed test and fits the machine: a trial would take its place; "
            "build with --size full, or move it away first"
        )


def _instead(config: Config) -> str:
    """What a machine that nothing can be trained for gets."""
    return (
        f"{config.machine.name}: nothing is built; it is watched without a model: protection and "
        "orbit analysis run as they are (`orbitd run`), and `orbitd commission start` on the "
        "healthy, running machine learns its own normal state, from which departures are named "
        "unknown"
    )


def _staged(made: RigBuild, console: Console) -> dict[str, StageResult]:
    """Every stage that is not left out, each done once."""
    rig = made.rig
    assert rig is not None
    results: dict[str, StageResult] = {}
    for stage, do in STAGES.items():
        if stage in made.left_out:
            continue
        console.rule(stage, align="left")
        results[stage], before = made.kept(stage, partial(do, made, rig))
        _said(console, stage, results[stage], before)
    console.rule("sealed test", align="left")
    results["sealed"], before = made.kept("sealed", partial(sealed, made, rig, results))
    _said(console, "sealed test", results["sealed"], before)
    return results


def _said(console: Console, stage: str, result: StageResult, before: bool) -> None:
    how = "kept from before" if before else f"{result.seconds:.0f} s"
    told = result.report.get("left_out") or result.report.get("reused") or ""
    console.print(f"{stage}: {told or 'done'} ({how})", markup=False, soft_wrap=True)


@contextmanager
def one_thread() -> Iterator[None]:
    """Linear algebra with one thread: sums in one order give the same bits on any count of
    cores."""
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        with threadpool_limits(1):
            yield
    finally:
        torch.set_num_threads(before)


def summary(made: RigBuild, results: dict[str, StageResult], there: Path) -> list[str]:
    """What was built, for people."""
    verdicts = results["sealed"].report
    lines = [f"{made.config.machine.name}: {there}"]
    for kind, name in KINDS.items():
        given = [stage for stage, result in results.items() if name in result.files]
        if not given:
            continue
        if "reused" in results[given[0]].report:
            said = f"reused: {results[given[0]].report['reused']}"
        elif kind in verdicts:
            held = verdicts[kind]["qualified"]
            said = "passed its sealed test" if held else "PROVISIONAL: missed a bar, see the report"
        else:
            said = "PROVISIONAL: no sealed test"
        lines.append(f"  {kind}: {said}")
    minutes = sum(result.seconds for stage, result in results.items() if stage != "sealed") / 60.0
    lines.append(
        f"  {minutes:.1f} min, sealed test {results['sealed'].seconds / 60.0:.1f} min; report "
        f"{there / REPORT}"
    )
    if made.size == "trial":
        lines.append(
            "  a TRIAL: it shows that everything works; build with --size full before relying on it"
        )
    return lines

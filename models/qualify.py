"""``orbitd evaluate MODEL --qualify``: judge a model on the frozen evaluation against bars that
training never reads.

A model has passed its sealed simulation test (status ``qualified``) only when every bar of
``bars.toml`` holds, and takes the shipped one's place only when it was made for this physics and is
not worse than the shipped one on the same evaluation: one that keeps every bar comes before one
that does not, and between equals one figure decides.
"""

from __future__ import annotations

import json
import shutil
import tomllib
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Literal

import msgspec

from firmware_py.brain.errors import ModelError
from firmware_py.brain.session import Session
from models import ARTIFACTS, PHYSICS_VERSION, card
from models.manifest import write_manifest, write_whole

Evaluate = Callable[[Path, int, int], dict[str, object]]
"""File, seed and size to the report of the evaluation."""


class QualifyError(ValueError):
    """A model cannot be judged or shipped; the text names file, value, limit and next step."""


class Bar(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """One figure of the report (dots between the keys) and its limit."""

    figure: str
    least: float | None = None
    most: float | None = None

    def holds(self, value: float | None) -> bool:
        """Whether ``value`` keeps the limit; a figure that the report lacks does not."""
        if value is None:
            return False
        return (self.least is None or value >= self.least) and (
            self.most is None or value <= self.most
        )


class Better(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The figure that two models are compared by."""

    figure: str
    good: Literal["least", "most"]


class Bars(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The frozen evaluation of one kind of model."""

    seed: int
    size: int
    better: Better
    bar: list[Bar]


@dataclass(frozen=True)
class Judged:
    """One bar, what was reached, and whether it holds."""

    figure: str
    reached: float | None
    least: float | None
    most: float | None
    holds: bool


def load_bars() -> dict[str, Bars]:
    """Bars by kind of model, from ``bars.toml`` beside this file."""
    text = Path(__file__).with_name("bars.toml").read_text(encoding="utf-8")
    return msgspec.convert(tomllib.loads(text), dict[str, Bars])


def qualify(
    kind: str,
    path: Path,
    evaluate: Evaluate,
    *,
    ship: bool,
    artifacts: Path = ARTIFACTS,
    bars: Bars | None = None,
) -> dict[str, object]:
    """Judge ``path``, write its status into it, and with ``ship`` put it in the place of the
    shipped model.

    A file that carries this verdict already stays byte for byte as it is: timings alone renew
    nothing.

    Raises
    ------
    QualifyError
        Made for another physics, damaged, or (with ``ship``) worse than the shipped model; nothing
        was changed.
    """
    bars = bars or load_bars()[kind]
    _check_physics(path)
    report = evaluate(path, bars.seed, bars.size)
    rows = _judged(bars, report)
    qualified = all(row.holds for row in rows)
    shipped = artifacts / path.name
    if ship and shipped.is_file() and shipped.resolve() != path.resolve() and _alike(path, shipped):
        _check_not_worse(path, bars, report, evaluate(shipped, bars.seed, bars.size))
    verdict = {
        "qualified": qualified,
        "seed": bars.seed,
        "size": bars.size,
        "bars": [asdict(row) for row in rows],
    }
    status = "qualified" if qualified else "provisional"
    if not _carries(path, status, verdict):
        _mark(path, status, verdict)
    if ship:
        _replace(path, artifacts)
    if ship or path.resolve() == shipped.resolve():
        write_manifest(artifacts)
    return {**verdict, "shipped": ship, "report": report}


def figure(report: Mapping[str, Any], dotted: str) -> float | None:
    """The number under ``dotted`` keys; None when the report has none there."""
    value: Any = report
    for key in dotted.split("."):
        value = value.get(key) if isinstance(value, Mapping) else None
    return float(value) if isinstance(value, (int, float)) else None


def _check_physics(path: Path) -> None:
    made_for = metadata(path).get("physics_version")
    if made_for != PHYSICS_VERSION:
        raise QualifyError(
            f"{path}: physics_version {made_for!r}, this checkout simulates {PHYSICS_VERSION!r}: "
            "train it again; nothing was changed"
        )


def metadata(path: Path) -> dict[str, str]:
    """What a model file says about itself.

    Raises
    ------
    QualifyError
        The file cannot be read as a model.
    """
    try:
        if path.suffix == ".json":
            return dict(json.loads(path.read_text(encoding="utf-8")))
        return Session(path.name, path.read_bytes()).metadata
    except (OSError, ValueError, ModelError) as error:
        raise QualifyError(
            f"{path}: no model that can be read ({error}); train and export it again"
        ) from error


def _alike(path: Path, shipped: Path) -> bool:
    """Whether both were made for the same physics and from the same inputs; else there is nothing
    to compare."""
    new, old = metadata(path), metadata(shipped)
    return all(new.get(key) == old.get(key) for key in ("physics_version", "inputs"))


def _judged(bars: Bars, report: Mapping[str, Any]) -> list[Judged]:
    return [
        Judged(bar.figure, value, bar.least, bar.most, bar.holds(value))
        for bar in bars.bar
        for value in (figure(report, bar.figure),)
    ]


def _check_not_worse(
    path: Path, bars: Bars, report: Mapping[str, Any], shipped: Mapping[str, Any]
) -> None:
    """Whoever keeps every bar comes before whoever does not; between equals the figure
    ``bars.better`` decides."""
    figure_name, good = bars.better.figure, bars.better.good
    new, old = figure(report, figure_name), figure(shipped, figure_name)
    if new is None:
        raise QualifyError(f"{path}: the evaluation gives no {figure_name}; nothing was changed")
    keeps, kept = (all(row.holds for row in _judged(bars, r)) for r in (report, shipped))
    if kept and not keeps:
        raise QualifyError(
            f"{path}: misses a bar that the shipped model keeps on the same evaluation: it stays; "
            "nothing was changed"
        )
    if keeps == kept and old is not None and (new > old if good == "least" else new < old):
        raise QualifyError(
            f"{path}: {figure_name} = {new:g}, the shipped model reaches {old:g} on the same "
            "evaluation: it stays; nothing was changed"
        )


def _carries(path: Path, status: str, verdict: Mapping[str, Any]) -> bool:
    """Whether the file and its report say all of this already, but for how long a call took."""
    report = path.with_suffix(".json")
    told = (
        json.loads(report.read_text(encoding="utf-8")).get("frozen_evaluation")
        if report.is_file()
        else None
    )
    return (
        metadata(path).get("status") == status
        and told is not None
        and _untimed(told) == _untimed(verdict)
    )


def _untimed(verdict: Mapping[str, Any]) -> dict[str, object]:
    """``verdict`` without what was reached in milliseconds."""
    bars = [
        bar | {"reached": None} if bar["figure"].startswith("milliseconds") else bar
        for bar in verdict["bars"]
    ]
    return {**verdict, "bars": bars}


def _mark(path: Path, status: str, verdict: Mapping[str, object]) -> None:
    """Write the status into the file's own metadata, and the verdict into its report and card."""
    import onnx

    if path.suffix == ".json":
        _write_json(path, {"status": status, "frozen_evaluation": verdict})
    else:
        model = onnx.load(str(path))
        onnx.helper.set_model_props(model, metadata(path) | {"status": status})
        write_whole(path, model.SerializeToString())
        if path.with_suffix(".json").is_file():
            _write_json(path.with_suffix(".json"), {"frozen_evaluation": verdict})
    if path.with_suffix(".md").is_file():
        card.settle(path.with_suffix(".md"), status, verdict)


def _write_json(path: Path, more: Mapping[str, object]) -> None:
    content = json.loads(path.read_text(encoding="utf-8")) | more
    write_whole(path, (json.dumps(content, indent=2, sort_keys=True) + "\n").encode())


def _replace(path: Path, artifacts: Path) -> None:
    """Copy the model with its report, its card and what stands beside it."""
    own = [path.with_suffix(suffix) for suffix in dict.fromkeys((path.suffix, ".json", ".md"))]
    for source in (*own, *path.parent.glob(f"{path.stem}_*.onnx")):
        if source.is_file() and source.resolve() != (artifacts / source.name).resolve():
            shutil.copyfile(source, artifacts / source.name)

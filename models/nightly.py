"""``make nightly``: final figures of what ships, by the whole device on the whole simulated rig.

Each scenario is flown three times with the shipped configuration: with the shipped policy in
charge, with a person's set point at the widest clearance (the simplest rule that comes near the
policy: the guard narrows it to what it admits), and with one class of fault for the shipped
classifier.  Each flight is one line of JSON as soon as it is over; what is there already is not
flown again, so that the work may be stopped at any time.  At the end stands a table over the
flights that are there.
"""

from __future__ import annotations

import argparse
import hashlib
import json
from collections import Counter
from pathlib import Path
from typing import Any, Final

import numpy as np

from firmware_py import __version__
from firmware_py.brain.store import Models, load_models
from firmware_py.brain.verdict import CLASSES
from firmware_py.config import Config
from firmware_py.options import count, seed
from models import PHYSICS_VERSION
from models.diagnosis.real_figures import REAL_SENTENCE
from models.diagnosis.recordings import FAULT_OF_CLASS
from models.whole_device import Scenario, fly, power_figures
from sim_hil.gym.control_task import Disturbances
from sim_hil.plant.build import Build
from sim_hil.plant.duty import Duty
from sim_hil.rigs import RigData, load_rig

SCENARIOS: Final = 50
DUTY_S: Final = 20.0
"""Judged time of policy and baseline, as long as the episodes of the scoreboard."""
DIAGNOSED_S: Final = 6.0
"""Judged time of the classifier: its fault has stood for 10 s by then."""
POLICY, WIDEST, CLASSIFIER = "policy", "widest", "classifier"
RUNS: Final = (POLICY, WIDEST, CLASSIFIER)
RESAMPLES: Final = 2000
Row = dict[str, Any]


def scenario(rig: RigData, number: int, run_seed: int, run: str) -> Scenario:
    """The machine and duty of a scenario; the classifier's holds its first point with the fault of
    class ``number``."""
    rng = np.random.default_rng([run_seed, number, 15])
    build, d = Build.draw(rig, rng), Disturbances()
    load_rate_N_s, speed_rate_rpm_s = d.ramps(rig)
    duty = Duty.random(
        rig,
        rng,
        DUTY_S,
        hold_s=d.hold_s,
        load_rate_N_s=load_rate_N_s,
        speed_rate_rpm_s=speed_rate_rpm_s,
    )
    noise = int(rng.integers(2**31))
    if run != CLASSIFIER:
        return Scenario(noise, build, duty, DUTY_S)
    name = FAULT_OF_CLASS[number % len(CLASSES)]
    severity = float(rng.choice((16.0, 40.0) if name == "unbalance" else (25.0, 0.0)))
    hold = Duty.hold(duty.speed_rpm[0], duty.load_N[0])
    return Scenario(noise, build, hold, DIAGNOSED_S, (name, severity) if name else None)


def flown(
    rig: RigData, config: Config, models: Models, number: int, run_seed: int, run: str
) -> Row:
    """The figures of one flight."""
    case = scenario(rig, number, run_seed, run)
    widest_um = config.machine.bearing.radial_clearance_max_um
    flight = fly(case, rig, config, models, widest_um if run == WIDEST else None)
    row: Row = power_figures(flight, config)
    if run == CLASSIFIER:
        words = [diagnosis.verdict for _, diagnosis in flight.diagnoses]
        row["class"] = list(CLASSES)[number % len(CLASSES)]
        row["severity"] = case.fault[1] if case.fault else None
        row["words"] = dict(Counter(words))
        row["confirmed"] = sorted(
            {d.verdict for _, d in flight.diagnoses if d.evidence["confirmed"]} & set(CLASSES)
        )
    return row


def key_of(models: Models, run_seed: int) -> str:
    """What flights must share to stand in one table: models, code version, physics, seed."""
    used = [m.sha256 for m in (models.actor, models.surrogate, models.classifier) if m]
    return hashlib.sha256(
        json.dumps([used, __version__, PHYSICS_VERSION, run_seed]).encode()
    ).hexdigest()[:12]


def read(path: Path, key: str) -> list[Row]:
    """Rows with ``key`` in ``path``; a last line that was torn is left out."""
    rows: list[Row] = []
    for line in path.read_text(encoding="utf-8").splitlines() if path.is_file() else []:
        try:
            row = json.loads(line)
        except json.JSONDecodeError:
            continue
        rows += [row] if row.get("key") == key else []
    return rows


def table(rows: list[Row], scenarios: int) -> list[str]:
    """What the flights say, with how many there are."""
    by_run = {run: {r["scenario"]: r for r in rows if r["run"] == run} for run in RUNS}
    lines = [f"{'':<12}{'flights':>10}{'power':>10}{'violation':>11}{'film':>9}{'authority':>11}"]
    for run in (POLICY, WIDEST):
        of_run = list(by_run[run].values())
        if of_run:
            power, broken, film, authority = (
                np.array([r[name] for r in of_run])
                for name in ("power_W", "violation_s", "min_film_um", "authority_share")
            )
            lines.append(
                f"{run:<12}{len(of_run):>7}/{scenarios:<2}{power.mean():>8.2f} W"
                f"{broken.sum():>9.1f} s{film.min():>6.1f} um{authority.mean():>11.3f}"
            )
    both = sorted(set(by_run[POLICY]) & set(by_run[WIDEST]))
    if both:
        less = np.array([by_run[POLICY][n]["power_W"] - by_run[WIDEST][n]["power_W"] for n in both])
        low, high = _interval(less)
        lines.append(f"policy less widest: {less.mean():+.3f} W [{low:+.3f}, {high:+.3f}] (95 %)")
    return lines + _named(list(by_run[CLASSIFIER].values()), scenarios)


def _named(rows: list[Row], scenarios: int) -> list[str]:
    """What the classifier said, class by class.

    All flights count, also of a machine that the guard tripped, which coasts and stands while it is
    judged; how many did is told beside.
    """
    if not rows:
        return []
    tripped = sum(bool(row["tripped"]) for row in rows)
    lines = [
        f"classifier: {len(rows)}/{scenarios} flights, {tripped} of them tripped by the guard; "
        "share of decisions"
    ]
    recall = []
    for name in CLASSES:
        words: Counter[str] = Counter()
        of_class = [r for r in rows if r["class"] == name]
        for row in of_class:
            words.update(row["words"])
        if not words:
            continue
        recall.append(words[name] / words.total())
        right = sum(r["confirmed"] == [name] for r in of_class)
        rest = ", ".join(f"{w} {n / words.total():.2f}" for w, n in words.items() if w != name)
        lines.append(
            f"  {name:<30}{recall[-1]:>6.2f} right, confirmed alone in {right} of {len(of_class)}"
            f"{'; ' + rest if rest else ''}"
        )
    lines.append(f"  mean over classes {np.mean(recall):.3f} (doubt and unknown count as misses)")
    return [*lines, f"  {REAL_SENTENCE}"]


def _interval(values: np.ndarray[Any, np.dtype[np.float64]]) -> tuple[float, float]:
    drawn = np.random.default_rng(0).integers(0, len(values), (RESAMPLES, len(values)))
    low, high = np.quantile(values[drawn].mean(axis=1), [0.025, 0.975])
    return float(low), float(high)


def main() -> int:
    """Fly what is missing, then print the table."""
    parser = argparse.ArgumentParser(prog="python -m models.nightly", description=__doc__)
    parser.add_argument("--scenarios", type=count, default=SCENARIOS)
    parser.add_argument("--seed", type=seed, default=1)
    parser.add_argument("--rig", default="bench")
    parser.add_argument("--out", type=Path, default=Path("nightly.jsonl"))
    parser.add_argument("--table", action="store_true", help="print the table of what is there")
    args = parser.parse_args()
    rig = load_rig(args.rig)
    config = rig.config
    models = load_models(config)
    key = key_of(models, args.seed)
    rows = read(args.out, key)
    done = {(row["scenario"], row["run"]) for row in rows}
    missing = [(n, run) for n in range(args.scenarios) for run in RUNS if (n, run) not in done]
    for number, run in [] if args.table else missing:
        row = flown(rig, config, models, number, args.seed, run)
        row = {"key": key, "seed": args.seed, "scenario": number, "run": run, **row}
        with args.out.open("a", encoding="utf-8") as stream:
            stream.write(json.dumps(row) + "\n")
        rows.append(row)
        print(f"scenario {number} {run}: {row['power_W']:.2f} W", flush=True)
    print("\n".join(table(rows, args.scenarios)))
    return 0


if __name__ == "__main__":
    raise SystemExit(main())

"""The report of a build: one file that says what was built, for which machine, how good it is
beside baselines, what each missing sensor costs, and what cannot be told apart."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from firmware_py import __version__
from firmware_py.brain.made_for import figures_of
from models import PHYSICS_VERSION
from models.builder.html import bars, listed, page, section, shown, table, text
from models.builder.rig_build import Report, RigBuild, StageResult
from models.diagnosis.scores import APART

Results = Mapping[str, StageResult]


def report_of(build: RigBuild, results: Results, real: Report) -> str:
    """The page."""
    name = build.config.machine.name
    return page(f"{name}: what was built for it", _parts(build, results, real))


def _parts(build: RigBuild, results: Results, real: Report) -> Iterator[str]:
    if build.size == "trial":
        yield text(
            "A TRIAL. Everything here was made in minutes to show that it works: few builds, short "
            "training, no sealed test. Its models are provisional and do not act unless "
            "authority.provisional_may_act says so. Build with --size full before relying on them.",
            "trial",
        )
    yield text(
        f"Made again, byte for byte on the same kind of processor, by `{build.command}` (orbitd "
        f"{__version__}, physics {PHYSICS_VERSION}). All figures are of simulated machines unless "
        "a line says otherwise.",
        "quiet",
    )
    yield _stages(build, results)
    yield _domains(build, results)
    if "classifier" in results:
        yield _diagnosis(results["classifier"].report, real)
    if "sensors" in results:
        yield _sensors(results["sensors"].report)
    if "predictor" in results:
        yield _forecasts(results["predictor"].report)
    if "policies" in results:
        yield _policies(results["policies"].report)
    yield _sealed(results["sealed"].report)
    yield section("Real machines", text(f"Of {real['of']}:"), *_real(real))


def _stages(build: RigBuild, results: Results) -> str:
    rows: list[tuple[Any, ...]] = []
    for stage, result in results.items():
        said = result.report.get("left_out") or result.report.get("reused") or "done"
        rows.append((stage, said, result.seconds))
    rows += [(stage, f"left out: {reason}", None) for stage, reason in build.left_out.items()]
    return section("What was done", table(("stage", "", "seconds"), rows))


def _domains(build: RigBuild, results: Results) -> str:
    rows = [(key, value) for key, value in figures_of(build.config.machine).items()]
    made = section(
        "For which machine",
        text(
            "A device takes these models for a machine whose figures are alike, whatever its name, "
            "and refuses them with the figures that differ."
        ),
        table(("figure", "of this machine"), rows),
    )
    film = results["surrogate"].report if "surrogate" in results else {}
    if "domain" in film:
        made += text("The film surrogate is dimensionless: it holds for any size, oil and speed in")
        made += listed(film["domain"])
    elif "trained_because" in film:
        made += text(f"The film surrogate was trained for this shape: {film['trained_because']}")
    return made


def _diagnosis(report: Report, real: Report) -> str:
    unseen = report["unseen_builds"]["required_severities_per_10_windows"]
    ladder = [
        (rung, rows.get("six_classes", {}).get("balanced_accuracy"))
        for rung, rows in report["ladder_on_unseen_builds"].items()
    ]
    grid = [
        (kind.replace("_", " "), severity, share)
        for kind, row in report["unseen_builds"]["right_class_by_severity"].items()
        for severity, share in row.items()
    ]
    words = [
        (kind.replace("_", " "), *row.values())
        for kind, row in report["unseen_builds"]["words_on_required_severities"].items()
    ]
    return section(
        "Diagnosis",
        text(
            "Balanced accuracy over six classes on builds that no training has seen, at the "
            "severities that must be found, beside simpler methods; chance is 0.17. Chosen: "
            f"{report['chosen']}."
        ),
        bars(ladder, 1.0, APART),
        text("Its figures, with 95 % intervals:"),
        listed(unseen),
        text(f"Real, beside it ({real['of']}):"),
        *_real(real),
        text("Pairs of classes that it cannot tell apart: " + _pairs("", report)[1]),
        text("What the device says of each class at those severities, as shares:"),
        table(("class", "right", "doubt", "unknown", "whirl", "another class"), words),
        text("Share named rightly by severity (percent of preload left, or balance grade):"),
        table(("class", "severity", "share"), grid),
        text("False alarms on healthy builds:"),
        listed(report["unseen_builds"]["false_alarms"]),
        text("Faults that were never taught:"),
        listed(report["unseen_builds"]["unknown_faults"]),
    )


def _sensors(report: Report) -> str:
    whole, without = report["all_sensors"], report["without"]
    rows = [("all sensors", whole["balanced_accuracy"])]
    rows += [(f"without {name}", row["balanced_accuracy"]) for name, row in without.items()]
    lines = [_pairs("with all sensors", whole)]
    lines += [_pairs(f"without {name}", row) for name, row in without.items()]
    return section(
        "What each missing sensor costs, and what cannot be told apart",
        text(
            "The same small network, trained again without what a sensor takes part in; balanced "
            "accuracy at the severities that must be found. These networks are smaller than the "
            "one that was built, so compare them with each other."
        ),
        bars(rows, 1.0, APART),
        text(
            f"Pairs of classes that cannot be told apart (balanced accuracy of the two below "
            f"{APART:g}):"
        ),
        table(("sensors", "pairs"), lines),
    )


def _pairs(name: str, row: Mapping[str, Any]) -> tuple[str, str]:
    told = [
        f"{' / '.join(each['classes'])} {each['balanced_accuracy']:.2f}".replace("_", " ")
        for each in row["cannot_be_told_apart"]
    ]
    return name, "; ".join(told) or "all are told apart"


def _forecasts(report: Report) -> str:
    parts = []
    for state, words in (
        ("as_built", "sensors as they are built"),
        ("zeroed", "after slow roll and zero"),
    ):
        found = report[state]
        coverage = [
            (f"{regime}: {quantity}".replace("_", " "), share)
            for regime, row in found["coverage"].items()
            for quantity, share in row.items()
        ]
        scores = [
            (regime, quantity, *(value for key, value in row.items() if "beats" not in key))
            for regime, table_of in found["interval_score"].items()
            for quantity, row in table_of.items()
        ]
        parts += [
            text(f"With {words}: share of forecasts inside their 90 % interval"),
            bars(coverage, 1.0, 0.9),
            text("Mean interval score, smaller is better, beside what stands in for a model:"),
            table(
                ("regime", "quantity", "predictor", "persistence", "table", "linear K, C"), scores
            ),
        ]
    first = report["as_built"]["power_within_5_percent"]
    return section(
        "Forecasts",
        text(f"{report['episodes']} unseen episodes of ten seconds, forecasts of two seconds."),
        text(
            "Power within 5 %, as a share: "
            + ", ".join(f"{name.replace('_', ' ')} {shown(share)}" for name, share in first.items())
        ),
        *parts,
    )


def _policies(report: Report) -> str:
    if "left_out" in report:
        return section("Policy", text(f"None was built: {report['left_out']}", "warn"))
    found = report["clearance"]
    rows = [
        (name.replace("_", " "), row["power_W"], row["violation_s"], row["min_film_um"])
        for name, row in found["policies"].items()
    ]
    most = max(row[1] for row in rows)
    return section(
        "Policy",
        text(
            f"Mean power on {found['episodes']} unseen episodes behind the guard's shield, and "
            f"without it; the {found['shipped']} is what was built. The best fixed clearance takes "
            f"{found['best_fixed_W']:.4g} W."
        ),
        bars([(row[0], row[1]) for row in rows], most, found["best_fixed_W"], " W"),
        table(("policy", "power, W", "violation, s", "smallest film, um"), rows),
    )


def _sealed(report: Report) -> str:
    if "left_out" in report:
        return section("Sealed test", text(report["left_out"], "warn"))
    parts = []
    for kind, verdict in report.items():
        passed = "passed" if verdict["qualified"] else "missed a bar: provisional"
        passed = verdict.get("left_out", passed)
        parts.append(text(f"{kind}: {passed} (seed {verdict['seed']}, size {verdict['size']})"))
        parts.append(
            table(
                ("figure", "reached", "least", "most", "holds"),
                [
                    (bar["figure"], bar["reached"], bar["least"], bar["most"], bar["holds"])
                    for bar in verdict["bars"]
                ],
            )
        )
    return section("Sealed test", *parts)


def _real(real: Report) -> list[str]:
    parts = [listed(real["figures"])]
    if "left_out" in real:
        parts.append(text(f"Left out: {real['left_out']}", "warn"))
    return parts

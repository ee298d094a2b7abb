"""`orbitd verify`: judges rows rightly, and everything quick is within tolerance."""

import contextlib
import io
import json
import math

import pytest

from sim_hil import verify
from sim_hil.verify.closed_forms import _side_leakage
from sim_hil.verify.row import ComparisonRow, reference, residual


@pytest.mark.parametrize(
    ("value", "expected", "absolute", "passed"),
    [
        (1.01, 1.0, False, True),
        (1.03, 1.0, False, False),
        (-103.0, -100.0, False, False),
        (10.015, 10.0, True, True),
    ],
)
def test_a_row_is_judged_by_its_tolerance(value, expected, absolute, passed):
    assert ComparisonRow("q", value, expected, "s", 0.02, absolute).passed is passed


def test_nan_never_passes_and_a_row_without_tolerance_is_not_judged():
    assert residual("q", math.nan, "s", 1.0).passed is False
    assert ComparisonRow("q", 1.0, 2.0, "s", None).passed is None


@pytest.fixture(scope="module")
def quick():
    output = io.StringIO()
    with contextlib.redirect_stdout(output):
        code = verify.main(["--quick", "--json"])
    return code, json.loads(output.getvalue())


def test_everything_quick_is_within_tolerance(quick):
    code, report = quick
    assert (code, report["failed"]) == (0, 0)
    assert len(report["rows"]) > 120
    assert {"quantity", "value", "reference", "source", "difference", "tolerance", "pass"} <= set(
        report["rows"][0]
    )


def test_a_row_outside_its_tolerance_ends_with_one(monkeypatch, capsys):
    monkeypatch.setattr(
        verify,
        "groups",
        lambda quick: {"g": lambda: iter([ComparisonRow("q", 2.0, 1.0, "s", 0.1)])},
    )
    assert verify.main([]) == 1
    assert "0 of 1 within tolerance" in capsys.readouterr().out


def test_a_table_of_hundred_columns_shows_every_row_and_its_source(monkeypatch, capsys):
    rows = [
        ComparisonRow("minimum film, um", 26.2, 26.1, "a table", 0.02),
        ComparisonRow("power, W", 9.0, 9.5, "another book", None),
    ]
    monkeypatch.setattr(verify, "groups", lambda quick: {"Group": lambda: iter(rows)})
    assert verify.main([]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert max(map(len, lines)) <= 100
    first = next(line for line in lines if "minimum film, um" in line)
    assert first.split()[3:] == ["26.2", "26.1", "0.383", "%", "2", "%", "yes", "a"]
    assert " b  another book" in lines


def test_side_leakage_is_exact_for_a_light_load():
    for ratio in (0.5, 1.0, 8.0):
        assert _side_leakage(1e-4, ratio) == pytest.approx(1 - math.tanh(ratio) / ratio, rel=1e-5)


def test_every_reference_row_is_in_the_quick_table(quick):
    quantities = " ".join(row["quantity"] for row in quick[1]["rows"])
    for name, label in (
        ("short_bearing_closed_form", "L/D=1/16 eps={}"),
        ("long_bearing_closed_form", "full eps={}"),
        ("raimondi_boyd_LD1", "eps={} (excerpt)"),
    ):
        for row in reference(f"{name}.json")["rows"]:
            assert label.format(row["eps"]) in quantities


@pytest.mark.slow
def test_everything_is_within_tolerance(capsys):
    assert verify.main(["--json"]) == 0
    assert json.loads(capsys.readouterr().out)["failed"] == 0

"""The table of measures: derived from the limits, changed by rows, refused where it cannot be."""

from __future__ import annotations

import shutil
from pathlib import Path

import msgspec
import pytest
from msgspec import inspect

from firmware_py import config
from firmware_py.config.bearings import views
from firmware_py.config.checks_added import ADDED_CHECKS
from firmware_py.config.checks_measures import oil_dangers
from firmware_py.config.meaning import meaning
from firmware_py.config.measure_schema import MeasureConfig
from firmware_py.config.measure_types import Effect, JudgedWhile
from firmware_py.config.measures import groups, measures, oil, probes_at, vibration
from firmware_py.machine.folder import shipped_names
from firmware_py.records import Severity


def changed(tmp_path: Path, text: str, name: str = "bench") -> config.Config:
    rig = tmp_path / name
    shutil.copytree(config.SHIPPED / name, rig)
    path = rig / "device.toml"
    path.write_text(path.read_text() + text)
    return config.load(rig)[0]


def faults(tmp_path: Path, text: str, name: str = "bench") -> dict[str, str]:
    with pytest.raises(config.ConfigError) as caught:
        changed(tmp_path, text, name)
    return {fault.key: f"{fault.cause}; {fault.next_step}" for fault in caught.value.faults}


BENCH_TABLE = [
    ("disp_x", 45.0, 70.0, "um", Effect.ALARM),
    ("disp_y", 45.0, 70.0, "um", Effect.ALARM),
    ("acc_bearing_vertical", 40.0, 80.0, "m/s2", Effect.ALARM),
    ("acc_bearing_horizontal", 40.0, 80.0, "m/s2", Effect.ALARM),
    ("acc_motor", 40.0, 80.0, "m/s2", Effect.ALARM),
    ("oil_pressure_low", 0.4, 0.25, "bar", Effect.AUTHORITY),
    ("oil_outlet_high", 60.0, 70.0, "degC", Effect.AUTHORITY),
]


def test_the_table_of_the_bench_is_that_of_its_limits() -> None:
    rows = measures(config.load(config.SHIPPED / "bench")[0])
    assert [
        (r.name, r.points[0].limit, r.points[1].limit, r.unit, r.points[0].effect) for r in rows[:7]
    ] == BENCH_TABLE
    cold, fast = rows[7:]
    assert (cold.name, len(cold.points), cold.sign) == ("oil_outlet_low", 1, -1.0)
    assert (fast.name, fast.points[0].alarm) == ("speed_high", "speed_high")
    assert fast.points[0].limit == pytest.approx(13200.0)
    delays = {(p.severity, p.delay_ns) for r in rows[:8] for p in r.points}
    assert delays == {(Severity.ALERT, 10**9), (Severity.DANGER, 3 * 10**9)}
    dangers = [p for r in rows for p in r.points if p.severity is Severity.DANGER]
    assert {(p.latching, p.effect) for p in dangers} == {(True, Effect.TRIP)}
    turning = [p.alarm for r in rows for p in r.points if p.judged is JudgedWhile.TURNING]
    assert turning == ["oil_pressure_low_danger"]
    assert [r.name for r in rows if r.capped] == ["disp_x", "disp_y"]


@pytest.mark.parametrize("name", shipped_names())
def test_every_bearing_sees_its_own_part_of_the_table(name: str) -> None:
    whole = config.load(config.SHIPPED / name)[0]
    by_bearing = [row for view in views(whole) for row in vibration(view.config)]
    assert [(r.name, [p.limit for p in r.points]) for r in by_bearing] == [
        (r.name, [p.limit for p in r.points]) for r in vibration(whole)
    ]
    named = {r.name: r.point(Severity.DANGER) is not None for r in oil(whole)}
    assert named == oil_dangers(whole)


def test_without_groups_every_danger_is_one_of_one() -> None:
    found = groups(config.load(config.SHIPPED / "bench")[0])
    assert {(g.vote, len(g.measures), g.declared) for g in found} == {("1oo1", 1, False)}
    assert [g.name for g in found][:2] == ["disp_x_danger", "disp_y_danger"]
    assert len(found) == 8


def test_a_row_changes_what_it_writes_and_nothing_else(tmp_path: Path) -> None:
    text = """
[[measure]]
name = "disp_y"
danger = 60.0
danger_delay_s = 1.5
hysteresis_share = 0.1
[[measure]]
name = "oil_outlet_high"
alert_effect = "alarm"
danger_effect = "retreat"
latching = false
alert_delay_s = 4.0
alert = 55.0
"""
    plain = measures(config.load(config.SHIPPED / "bench")[0])
    found = measures(changed(tmp_path, text))
    assert [a for a, b in zip(found, plain, strict=True) if a == b] == [
        row for row in plain if row.name not in ("disp_y", "oil_outlet_high")
    ]
    y, hot = (next(r for r in found if r.name == n) for n in ("disp_y", "oil_outlet_high"))
    assert (y.points[0].limit, y.points[1].limit, y.points[1].delay_ns) == (45.0, 60.0, 1.5e9)
    assert (y.hysteresis, y.points[1].key) == (0.1, "measure[0].danger")
    assert (hot.points[0].effect, hot.points[0].delay_ns) == (Effect.ALARM, 4 * 10**9)
    assert (hot.points[1].effect, hot.points[1].latching) == (Effect.RETREAT, False)


def test_a_group_takes_its_measures_from_those_that_trip_alone(tmp_path: Path) -> None:
    text = '[[group]]\nname = "shaft"\nmeasures = ["disp_x", "disp_y"]\nvote = "2oo2"\n'
    shaft, *alone = groups(changed(tmp_path, text))
    assert (shaft.trip, shaft.vote, shaft.measures, shaft.all_not_ok) == (
        "shaft_trip", "2oo2", ("disp_x", "disp_y"), Effect.AUTHORITY,
    )  # fmt: skip
    assert "disp_x_danger" not in [g.name for g in alone]


def test_what_cannot_be_is_refused_all_at_once(tmp_path: Path) -> None:
    text = """
[[measure]]
name = "disp_x"
alert = 80.0
[[measure]]
name = "disp_x"
[[measure]]
name = "speed_high"
[[measure]]
name = "disp_z"
[[measure]]
name = "oil_pressure_low"
danger = 0.45
latching = false
[[measure]]
name = "oil_outlet_low"
danger = 10.0
[[measure]]
name = "acc_motor"
danger = 120.0
danger_effect = "alarm"
[[group]]
name = "none"
measures = []
vote = "1oo2"
[[group]]
name = "none"
measures = ["disp_x"]
vote = "2oo2"
[[group]]
name = "more"
measures = ["disp_x", "speed_high", "acc_motor"]
vote = "2oo3"
[[group]]
name = "microphone"
measures = ["disp_q", "oil_outlet_low"]
vote = "2oo2_strict"
"""
    found = faults(tmp_path, text)
    words = {
        "measure[1].name": "written twice",
        "measure[2].name": "set limits.speed_high_rpm",
        "measure[3].name": "no measure of that name, there are: disp_x",
        "measure[4].latching": "a trip is latched",
        "measure[4].danger": "danger 0.45 bar of oil_pressure_low is not below its alert 0.4",
        "measure[5].danger": "has no danger; remove it",
        "measure[6].danger": "outside 0 .. 97.5 m/s2, what acc_motor can show",
        "group[0].measures": "a vote over an empty group; name 2",
        "group[1].name": "named twice",
        "group[1].measures": "1 measures, 2oo2 counts 2",
        "group[2].measures[0]": "votes already",
        "group[2].measures[1]": "trips alone, always",
        "group[2].measures[2]": "its danger_effect is alarm",
        "group[3].name": "a channel or reading has alarms of that name",
        "group[3].measures[0]": "no measure of that name",
        "group[3].measures[1]": "has no danger that could vote",
    }
    assert set(found) == set(words)
    assert {key: text for key, text in words.items() if text not in found[key]} == {}


ACTS = """
[[measure]]
name = "casing"
quantity = "velocity_rms"
source = "acc_motor"
unit = "mm/s"
alert = 0.0045
danger = 0.0071
[[measure]]
name = "disp_x"
alert = 0.045
[[measure]]
name = "late"
quantity = "rms"
source = "acc_motor"
unit = "m/s2"
danger = 20.0
from_rpm = 12001.0
[[measure]]
name = "high"
quantity = "velocity_rms"
source = "acc_motor"
unit = "mm/s"
alert = 4.5
band_low_hz = 201.0
[[measure]]
name = "disp_y"
danger = 85.0
[[measure]]
name = "orbit"
quantity = "smax"
unit = "um"
danger = 43.0
[[measure]]
name = "acc_motor"
alert_effect = "retreat"
danger_effect = "alarm"
[[measure]]
name = "oil_outlet_high"
danger_effect = "event"
latching = false
[[multiply]]
name = "beyond"
measures = ["disp_x"]
factor = 2.0
from_rpm = 12001.0
to_rpm = 13000.0
max_s = 20.0
reset_rpm = 3000.0
"""


def test_what_acts_never_or_always_is_refused_all_at_once(tmp_path: Path) -> None:
    found = faults(tmp_path, ACTS)
    words = {
        "measure[0].alert": "write it in mm/s, not in m/s",
        "measure[0].danger": "not above 0.113 mm/s",
        "measure[1].alert": "write it in um, not in m or mm",
        "measure[2].from_rpm": "above operating.speed_max_rpm (12000)",
        "measure[3].band_low_hz": "above 200 Hz, the first order",
        "measure[4].danger": "above 0.7 x diametral clearance (120 um)",
        "measure[5].danger": "above 0.35 x diametral clearance (120 um)",
        "measure[6].danger_effect": "danger does less (alarm) than alert (retreat)",
        "measure[7].danger_effect": "danger does less (event) than alert (authority)",
        "multiply[0].from_rpm": "above operating.speed_max_rpm (12000)",
    }
    assert {key: text for key, text in words.items() if text not in found.get(key, "")} == {}
    assert set(found) == set(words)


def test_a_further_bearing_has_its_own_clearance(tmp_path: Path) -> None:
    text = '[[limits_at]]\nbearing = "nde"\ndisplacement_alert_um = 75.0\n'
    found = faults(tmp_path, f"{text}displacement_danger_um = 270.0\n", "kit")
    assert "x diametral clearance (380 um)" in found["limits_at[1].displacement_danger_um"]


def test_an_alert_trips_nothing_and_its_remark_says_so(tmp_path: Path) -> None:
    found = faults(tmp_path, '[[measure]]\nname = "disp_x"\nalert_effect = "trip"\n')
    assert "alarm, authority, event, retreat" in found["measure[0].alert_effect"]
    fields = inspect.type_info(MeasureConfig).fields  # type: ignore[attr-defined]
    field = next(each for each in fields if each.name == "alert_effect")
    assert '"trip"' not in meaning(MeasureConfig, field)


def test_limits_that_cross_are_named_where_they_are_written(tmp_path: Path) -> None:
    found = faults(tmp_path, '[[measure]]\nname = "disp_x"\nalert = 80.0\n')
    assert found == {
        "measure[0].alert": "danger 70 um of disp_x is not above its alert 80; part them"
    }


def test_a_probe_shows_the_danger_that_is_written(tmp_path: Path) -> None:
    found = faults(tmp_path, '[[measure]]\nname = "disp_x"\ndanger = 600.0\n')
    assert "what disp_x can show" in found["measure[0].danger"]


def test_a_machine_without_oil_has_no_rows_for_it(tmp_path: Path) -> None:
    text = '[[measure]]\nname = "oil_pressure_low"\nalert = 1.0\n'
    found = faults(tmp_path, text, "kit")
    assert "no measure of that name" in found["measure[0].name"]


WINDOW = 'sense = "window"\nalert_low = 0.1\ndanger_low = 0.05\ndanger = 4.0'
ADDED = """
[[measure]]
name = "{name}"
quantity = "{quantity}"
source = "{source}"
unit = "{unit}"
"""


@pytest.mark.parametrize(
    ("quantity", "source", "unit", "more"),
    [
        ("peak_to_peak", "disp_x", "um", ""),
        ("amplitude_1x", "disp_y", "um", ""),
        ("amplitude_not_1x", "disp_y", "um", ""),
        ("smax", "", "um", ""),
        ("position", "", "share", ""),
        ("rms", "acc_motor", "m/s2", ""),
        ("velocity_rms", "acc_motor", "mm/s", "band_low_hz = 5.0"),
        (
            "mean",
            "supply_pressure",
            "bar",
            'sense = "window"\nalert_low = 0.1\ndanger_low = 0.05\ndanger = 4.0',
        ),
        ("reading", "oil_outlet", "degC", ""),
        ("speed", "", "rpm", 'sense = "falling"\njudged = "armed"\ndanger = 0.5'),
    ],
)
def test_every_quantity_can_be_added(
    tmp_path: Path, quantity: str, source: str, unit: str, more: str
) -> None:
    text = ADDED.format(name="new", quantity=quantity, source=source, unit=unit)
    row = measures(changed(tmp_path, f"{text}alert = 1.0\n{more}\n"))[-1]
    assert (row.name, row.kind, row.unit) == ("new", quantity, unit)
    assert row.points[0].alarm == "new_alert"
    assert row.capped is (quantity in ("peak_to_peak", "smax"))


WRONG = """
[[measure]]
name = "a"
quantity = "velocity_rms"
source = "disp_x"
unit = "mm/s"
alert = 1.0
[[measure]]
name = "b"
quantity = "reading"
source = "oil_outlet"
unit = "bar"
alert = 1.0
[[measure]]
name = "c"
quantity = "peak_to_peak"
source = "disp_q"
unit = "um"
[[measure]]
name = "d"
quantity = "reading"
source = "metal"
unit = "degC"
alert = 80.0
danger = 70.0
[[measure]]
name = "e"
quantity = "smax"
source = "nde"
unit = "um"
sense = "falling"
alert = 10.0
danger = 20.0
[[measure]]
name = "f"
quantity = "speed"
source = "mark"
unit = "rpm"
sense = "window"
alert_low = 3000.0
danger_low = 3500.0
alert = 2000.0
from_rpm = 5000.0
to_rpm = 4000.0
[[measure]]
name = "g"
quantity = "velocity_rms"
source = "acc_motor"
unit = "mm/s"
danger = 100.0
band_low_hz = 900.0
[[measure]]
name = "h"
quantity = "mean"
source = "supply_pressure"
unit = "bar"
danger = 400.0
danger_low = 1.0
[[measure]]
name = "i"
quantity = "amplitude_1x"
source = "disp_x"
unit = "um"
danger = 600.0
[[measure]]
name = "disp_x"
quantity = "peak_to_peak"
source = "disp_x"
unit = "um"
alert = 10.0
[[measure]]
name = "disp_y"
source = "disp_y"
to_rpm = 100.0
"""


def test_an_added_measure_that_cannot_be_is_refused_all_at_once(tmp_path: Path) -> None:
    found = faults(tmp_path, WRONG)
    words = {
        "measure[0].source": "a channel of displacement has no velocity_rms, only acceleration",
        "measure[1].unit": "reading of oil_outlet is in degC",
        "measure[2].source": "no channel of that name",
        "measure[2].danger": "neither alert nor danger",
        "measure[3].source": "no slow reading of that name",
        "measure[3].danger": "not above alert (80); part them",
        "measure[4].source": "no bearing of that name, there are: only one, without a name",
        "measure[4].danger": "not below alert (10); part them",
        "measure[5].source": "the speed is that of the mark",
        "measure[5].danger": "a window has two ends",
        "measure[5].alert_low": "not above danger_low (3500)",
        "measure[5].alert": "not above alert_low (3000)",
        "measure[5].from_rpm": "not below to_rpm (4000)",
        "measure[6].danger": "its peak times 5 is 888.6 m/s2, acc_motor shows up to 195",
        "measure[6].band_low_hz": "above 500 Hz",
        "measure[7].danger": "what supply_pressure shows",
        "measure[7].danger_low": "write sense = window",
        "measure[8].danger": "what disp_x can show",
        "measure[9].name": "is there already",
        "measure[10].source": "belongs to an added measure",
        "measure[10].to_rpm": "belongs to an added measure",
    }
    assert set(found) == set(words)
    assert {key: text for key, text in words.items() if text not in found[key]} == {}


def test_a_bearing_without_a_clearance_has_no_position(tmp_path: Path) -> None:
    rig = tmp_path / "kit"
    shutil.copytree(config.SHIPPED / "kit", rig)
    device, machine = rig / "device.toml", rig / "machine.toml"
    lines = machine.read_text().splitlines()
    machine.write_text("\n".join(x for x in lines if "radial_clearance" not in x) + "\n")
    text = ADDED.format(name="p", quantity="position", source="", unit="share")
    device.write_text(device.read_text().replace("clearance_share", "# share") + text)
    device.write_text(device.read_text() + "alert = 0.5\n")
    with pytest.raises(config.ConfigError, match="the clearance of the bearing is not known"):
        config.load(rig)


def test_windows_and_bypasses_that_cannot_be_are_refused_all_at_once(tmp_path: Path) -> None:
    text = """
[[measure]]
name = "disp_x"
may_bypass = true
[[measure]]
name = "oil_outlet_low"
may_bypass = true
[[group]]
name = "alone"
measures = ["disp_x"]
vote = "1oo1"
[[multiply]]
name = "critical"
measures = []
factor = 2.0
from_rpm = 3000.0
to_rpm = 2000.0
[[multiply]]
name = "critical"
measures = ["disp_x", "oil_pressure_low"]
factor = 3.0
from_rpm = 3000.0
to_rpm = 4000.0
max_s = 20.0
reset_rpm = 3000.0
"""
    found = faults(tmp_path, text)
    words = {
        "measure[0].may_bypass": "disp_x is the last channel of alone",
        "measure[1].may_bypass": "has no danger that could be bypassed",
        "multiply[0].measures": "names no measure",
        "multiply[0].from_rpm": "not below to_rpm (2000)",
        "multiply[0].max_s": "a multiply without end",
        "multiply[0].reset_rpm": "a window without reset",
        "multiply[1].name": "named twice",
        "multiply[1].measures[1]": "no rising measure of that name",
        "multiply[1].reset_rpm": "not below from_rpm (3000)",
    }
    assert set(found) == set(words)
    assert {key: text for key, text in words.items() if text not in found[key]} == {}


def test_smax_of_a_further_bearing_is_that_of_its_own_probes(tmp_path: Path) -> None:
    text = ADDED.format(name="orbit_nde", quantity="smax", source="nde", unit="um")
    loaded = changed(tmp_path, f"{text}alert = 50.0\n", "kit")
    assert measures(loaded)[-1].source == "nde"
    places = probes_at(loaded, "nde")
    assert {loaded.machine.channel[i].bearing for i in places} == {"nde"}
    assert not set(places) & set(probes_at(loaded, ""))


@pytest.mark.parametrize(("danger", "faulty"), [(18.0, False), (30.0, True)])
def test_a_velocity_sensor_has_five_times_the_range_of_danger(danger: float, faulty: bool) -> None:
    bench = config.load(config.SHIPPED / "bench")[0]
    pickup = msgspec.structs.replace(
        bench.machine.channel[4], name="vel", kind="velocity", unit="m/s", scale=1e-5,
        ok_low=-0.15, ok_high=0.15,
    )  # fmt: skip
    row = MeasureConfig("casing", quantity="rms", source="vel", unit="mm/s", danger=danger)
    seen = bench.replaced(channel=[*bench.machine.channel[:4], pickup], measure=[row])
    found = [each for check in ADDED_CHECKS for each in check(seen)]
    assert bool(found) is faulty
    assert all("its peak times 5 is" in cause for _, _, cause in found)

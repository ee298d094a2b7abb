"""Orifice and capillary: closed forms at both ends, and what a bad description is told."""

from __future__ import annotations

from itertools import pairwise
from math import pi, sqrt
from pathlib import Path
from typing import Any

import msgspec
import pytest

from firmware_py import config
from firmware_py.machine import FeedPort
from firmware_py.machine.parts import has_film_law, monitor_only
from firmware_py.machine.restrictor import (
    NONE,
    bore_Re,
    capillary,
    opening,
    orifice,
    restrictor,
)
from firmware_py.machine.supply import restricted_m3_s

RHO, MU = 998.0, 1e-3
BORE = 1e-3
SEED = config.load(config.SHIPPED / "seed")[0]


def test_a_wide_orifice_follows_its_discharge_coefficient() -> None:
    law = orifice(BORE, 0.61, RHO, pi * BORE)
    expected = 0.61 * 0.25 * pi * BORE**2 * sqrt(2.0 * 4e5 / RHO)
    assert law.flow_m3_s(4e5, 1e-9, 1.0) == pytest.approx(expected, rel=1e-6)
    assert law.flow_m3_s(-4e5, 1e-9, 1.0) == pytest.approx(-expected, rel=1e-6)


@pytest.mark.parametrize("film_m", [20e-6, 60e-6, 250e-6, 1e-3])
def test_bore_and_curtain_in_series_are_lunds_area(film_m: float) -> None:
    law = orifice(BORE, 0.61, RHO, pi * BORE)
    delta = BORE / (4.0 * film_m)  # bore area over curtain area
    area = 0.25 * pi * BORE**2 / sqrt(1.0 + delta * delta)
    expected = 0.61 * area * sqrt(2.0 * 4e5 / RHO)
    assert law.flow_m3_s(4e5, 1e-12, film_m) == pytest.approx(expected, rel=1e-6)


def test_at_low_reynolds_number_the_discharge_coefficient_is_merritts() -> None:
    law, drop = orifice(BORE, 0.61, RHO, pi * BORE), 1e-2
    mu = 1.0
    flow = law.flow_m3_s(drop, mu, 1.0)
    area = 0.25 * pi * BORE**2
    reynolds = RHO * (flow / area) * BORE / mu
    assert reynolds < 1e-3
    coefficient = flow / (area * sqrt(2.0 * drop / RHO))
    assert coefficient == pytest.approx(0.2 * sqrt(reynolds), rel=1e-3)


def test_a_capillary_is_hagen_poiseuilles() -> None:
    law = capillary(0.3e-3, 30e-3)
    expected = pi * 0.3e-3**4 * 2e5 / (128.0 * 0.01 * 30e-3)
    assert law.flow_m3_s(2e5, 0.01, 60e-6) == pytest.approx(expected, rel=1e-12)


def test_flow_rises_with_the_drop_without_a_step() -> None:
    law = orifice(BORE, 0.61, RHO, pi * BORE)
    drops = [10.0 ** (k / 4) for k in range(-20, 28)]
    flows = [law.flow_m3_s(drop, MU, 60e-6) for drop in drops]
    assert law.flow_m3_s(0.0, MU, 60e-6) == 0.0
    assert all(a < b for a, b in pairwise(flows))


def test_air_makes_a_recess_soft_and_pressure_hardens_it() -> None:
    recess = NONE._replace(volume_m3=1e-7)
    foam = recess._replace(air_share=0.05)
    assert foam.stored_m3_Pa(0.0) == pytest.approx(1e-7 * 0.05 / 1.013e5, rel=1e-2)
    assert foam.stored_m3_Pa(0.0) > 500.0 * recess.stored_m3_Pa(0.0)
    assert foam.stored_m3_Pa(9e5) < 0.02 * foam.stored_m3_Pa(0.0)


def test_what_a_row_says_of_its_opening() -> None:
    bare = opening(FeedPort("orifice", 45.0, bore_mm=1.0), 0.02)
    assert (bare.width_rad, bare.length_m, bare.elliptic) == (0.05, 1e-3, True)
    assert bare.perimeter_m(0.02) == pytest.approx(pi * 1e-3)
    pocket = FeedPort("capillary", 45.0, 3.0, bore_mm=0.5, recess_width_deg=20.0,
                      recess_length_mm=8.0, capillary_length_mm=20.0)  # fmt: skip
    assert not opening(pocket, 0.02).elliptic
    assert opening(pocket, 0.02).axial_m == pytest.approx(3e-3)
    assert restrictor(FeedPort("port", 0.0, bore_mm=1.0), 0.02, RHO) == NONE
    assert bore_Re(pocket, 1e-6, RHO, MU) == pytest.approx(4 * RHO * 1e-6 / (pi * 5e-4 * MU))


def test_the_machine_of_the_paper_is_monitor_only_by_name() -> None:
    machine = SEED.machine
    assert len(machine.feed_port) == 4
    assert not has_film_law(machine)
    (why,) = monitor_only(machine)
    assert why.startswith("feed_port: 4 orifices: the guard's laws know no feed but one groove")
    plain = msgspec.structs.replace(machine, feed_port=[])
    assert monitor_only(plain) == ()


def test_the_pump_is_held_against_what_the_restrictors_let_through() -> None:
    machine = SEED.machine
    each = orifice(BORE, 0.61, RHO, pi * BORE)
    assert restricted_m3_s(machine, 60e-6) == pytest.approx(
        4 * each.flow_m3_s(5.4e5, 0.00067, 60e-6), rel=1e-3
    )
    weak = msgspec.structs.replace(
        machine.feed, pump_shut_off_bar=8.0, pump_flow_max_m3_s=2e-5, full_film_bar=1.0
    )
    told = said(SEED.replaced(feed=weak))
    assert "film's greatest flow" in told["machine.feed.pressure_max_bar"]


def said(changed: config.Config) -> dict[str, str]:
    from firmware_py.config.checks import RELATED

    return {key: cause for check in RELATED for key, _, cause in check(changed)}


ROW: dict[str, Any] = {"kind": "orifice", "angle_deg": 90.0, "bore_mm": 1.0}


@pytest.mark.parametrize(
    ("rows", "key", "words"),
    [
        ([{"bore_mm": None}], "[0].bore_mm", "missing of this orifice"),
        ([{"kind": "capillary"}], "[0].capillary_length_mm", "missing of this capillary"),
        ([{"kind": "capillary", "capillary_length_mm": 10.0}], "[0].capillary_length_mm",
         "10 bores, below 20"),
        ([{"capillary_length_mm": 30.0}], "[0].capillary_length_mm", "has no length"),
        ([{"kind": "groove", "bore_mm": None}], "[0].recess_width_deg", "missing of this groove"),
        ([{"recess_width_deg": 20.0}], "[0].recess_length_mm", "missing"),
        ([{"recess_width_deg": 1.0, "recess_length_mm": 8.0}], "[0].bore_mm", "wider than the"),
        ([{"axial_mm": 9.6}], "[0].axial_mm", "reaches 10.1 mm from the middle"),
        ([{}, {"angle_deg": 92.0}], "[1].angle_deg", "lies over feed_port[0]"),
        ([{"kind": "port", "discharge_coefficient": 0.8}], "[0].discharge_coefficient",
         "a port has none"),
    ],
)  # fmt: skip
def test_what_cannot_be_is_named(rows: list[dict[str, Any]], key: str, words: str) -> None:
    ports = [FeedPort(**(ROW | row)) for row in rows]
    told = said(SEED.replaced(feed_port=ports))
    assert words in told[f"machine.feed_port{key}"], told


def test_openings_stand_in_one_place_only() -> None:
    groove = msgspec.structs.replace(
        SEED.machine.feed, groove_angle_deg=90.0, groove_width_deg=20.0, groove_length_share=0.8
    )
    assert (
        "stands beside [[feed_port]]"
        in said(SEED.replaced(feed=groove))["machine.feed.groove_angle_deg"]
    )


def test_a_folder_with_openings_is_written_and_read_alike(tmp_path: Path) -> None:
    from firmware_py.commands.rig_new import texts_for
    from firmware_py.config.written import write_rig

    write_rig(texts_for("seed", "mine"), tmp_path / "mine")
    again = config.load(tmp_path / "mine")[0].machine
    assert again.feed_port == SEED.machine.feed_port

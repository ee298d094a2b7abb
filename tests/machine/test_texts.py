"""Every key of a rig folder says what it means, in which unit, and where its figure comes from."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest
from msgspec import inspect

from firmware_py.config import Config
from firmware_py.machine import Machine
from firmware_py.machine.simulation import Simulation
from firmware_py.machine.texts import head_of, texts_of, unit_of
from firmware_py.machine.values import MachineTable, Section

CHOSEN = {
    "name",
    "bearing",
    "absent",
    "unit",
    "kind",
    "wire_scale",
    "words",
    *MachineTable.__struct_fields__,
}
"""Keys that name something, or choose."""

OF_THE_CHANNEL = {
    "scale", "offset", "ok_low", "ok_high", "range_low", "range_high", "zero_error",
    "zeroed_zero_error", "noise_rms", "wire_scale", "alert", "danger", "alert_low", "danger_low",
}  # fmt: skip
PURE = {
    "pump_efficiency", "reversals_per_minute_max", "frames_per_block", "good_advices",
    "max_regains_per_hour", "port", "discharge_coefficient", "instant", "friction", "damping_ratio",
    "teeth", "count", "preload", "factor", "disagreement_max", "disagreement_decisions",
}  # fmt: skip
"""Numbers without a unit: counts and ratios."""


def tables(cls: type[Section]) -> Iterator[type[Section]]:
    """``cls`` and every table below it."""
    yield cls
    for field in inspect.type_info(cls).fields:  # type: ignore[attr-defined]
        for kind in leaves(field.type):
            if isinstance(kind, inspect.StructType):
                yield from tables(kind.cls)  # type: ignore[arg-type]


def leaves(kind: inspect.Type) -> list[Any]:
    if isinstance(kind, inspect.UnionType):
        return [leaf for each in kind.types for leaf in leaves(each)]
    return [kind.item_type if isinstance(kind, inspect.ListType | inspect.VarTupleType) else kind]


ALL = list(dict.fromkeys([*tables(Config), *tables(Simulation)]))
MACHINE = set(tables(Machine))


@pytest.mark.parametrize("cls", ALL, ids=lambda cls: cls.__name__)
def test_every_key_has_a_text_and_every_number_a_unit(cls: type[Section]) -> None:
    assert head_of(cls)
    texts = texts_of(cls)
    for field in inspect.type_info(cls).fields:  # type: ignore[attr-defined]
        kinds = leaves(field.type)
        if any(isinstance(kind, inspect.StructType) for kind in kinds):
            continue
        text = texts.get(field.name, "")
        assert text.endswith("."), f"{cls.__name__}.{field.name}: {text!r}"
        assert "``" not in text
        assert ":mod:" not in text
        if cls in MACHINE and field.name not in CHOSEN:
            assert "From: " in text, f"{cls.__name__}.{field.name}: say where the figure comes from"
        if any(isinstance(kind, inspect.IntType | inspect.FloatType) for kind in kinds):
            known = unit_of(field.name) or field.name in OF_THE_CHANNEL | PURE | {"schema"}
            assert known, f"{cls.__name__}.{field.name}"


def test_units_are_those_of_the_longest_end() -> None:
    keys = {
        "coupling_damping_N_s_m": "N s/m", "load_ramp_unannounced_N_s": "N/s", "length_m": "m",
        "coupling_stiffness_N_m": "N/m", "heat_capacity_J_kgK": "J/(kg K)", "rate_um_s": "um/s",
        "viscosity_at_40C_Pa_s": "Pa s", "viscosity_slope_per_K": "1/K", "windage_W_s3": "W s3",
        "speed_ramp_max_rpm_s": "rpm/s", "inlet_min_C": "degC", "good_advices": "",
    }  # fmt: skip
    assert {key: unit_of(key) for key in keys} == keys

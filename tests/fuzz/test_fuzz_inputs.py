"""The short form of the fuzzing: a few hundred damaged examples of each input, and what hypothesis
thinks of."""

from __future__ import annotations

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from . import inputs
from .targets import INPUTS, Input

NAMES = [each.name for each in INPUTS]
SHORT = {"guard_memory": 25, "normal_file": 200, "manifest": 200}


@pytest.mark.parametrize("name", NAMES)
def test_damaged_examples_raise_nothing_and_take_no_time(name, tmp_path):
    assert inputs.run(name, 0, SHORT.get(name, 500), tmp_path).failures == []


@pytest.mark.parametrize("name", [name for name in NAMES if name not in SHORT])
@given(
    data=st.one_of(
        st.binary(max_size=400),
        st.text(max_size=100).map(lambda text: text.encode("utf-8", "replace")),
    )
)
@settings(max_examples=40, deadline=None, suppress_health_check=[HealthCheck.too_slow])
def test_any_bytes_raise_nothing_and_take_no_time(name, data):
    assert inputs.wrong_with(name, data) == []


def test_a_failure_names_its_case(monkeypatch, tmp_path):
    def build():
        def feed(data):
            raise KeyError(data)

        return feed, [b"x"]

    monkeypatch.setattr(inputs, "INPUTS", [Input("broken", build, 1, "")])
    assert (
        inputs.run("broken", 3, 1, tmp_path, 7)
        .failures[0]
        .startswith("broken, seed 3, case 7: KeyError")
    )

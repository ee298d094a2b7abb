"""The list of trusted keys in a file of a person's: only it changes, or nothing does."""

from __future__ import annotations

import tomllib

import pytest

from firmware_py.model_sets.errors import SetError
from firmware_py.model_sets.own_keys import with_public_keys

TEXTS = {
    "absent": "[device]\nsite = 'a'",
    "no models": "[device]\nsite = 'a'\n\n[bus]\nlink = 'can'\n",
    "remark": "[models]  # which\n# public_keys = []\ndeadline_ms = 5.0\n[bus]\nlink = 'can'\n",
    "one": "[models]\npublic_keys = ['old']  # mine\ndeadline_ms = 5.0\n",
    "many": '[models]\ndeadline_ms = 5.0\npublic_keys = [\n  "x", # ] first\n  "y",\n]\n\n[bus]\n',
}


@pytest.mark.parametrize("text", TEXTS.values(), ids=TEXTS)
@pytest.mark.parametrize("keys", [[], ["A+/="], ["A", "B"]])
def test_only_the_keys_change(text: str, keys: list[str]) -> None:
    found = tomllib.loads(with_public_keys(text, keys))
    wanted = tomllib.loads(text)
    wanted.setdefault("models", {})["public_keys"] = keys
    assert found == wanted
    remarks = [line for line in text.splitlines() if line.startswith("#")]
    assert all(line in with_public_keys(text, keys) for line in remarks)


def test_a_layout_that_is_not_understood_is_left_alone() -> None:
    with pytest.raises(SetError, match=r'write it by hand into \[models\]: public_keys = \["A"\]'):
        with_public_keys("models.public_keys = ['x']\n", ["A"])
    with pytest.raises(SetError):
        with_public_keys("models = { deadline_ms = 5.0 }\n", ["A"])

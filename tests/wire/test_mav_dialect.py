"""The published dialect: generated from its XML, understood by ground stations, matched by our codec."""

from __future__ import annotations

import contextlib
import io
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from pymavlink.dialects.v20 import common
from pymavlink.generator import mavgen, mavparse

from firmware_py.wire import mav_dialect
from firmware_py.wire.mav_packet import CRC_EXTRA

WIRE = Path(mav_dialect.__file__).parent
STANDARD = [message_id for message_id in CRC_EXTRA if message_id < 52001]


def test_generated_module_is_up_to_date(tmp_path: Path) -> None:
    fresh = tmp_path / "mav_dialect.py"
    options = mavgen.Opts(str(fresh), wire_protocol=mavparse.PROTOCOL_2_0, language="Python3")
    with contextlib.redirect_stdout(io.StringIO()):
        assert mavgen.mavgen(options, [str(WIRE / "orbitd.xml")])
    assert fresh.read_text() == (WIRE / "mav_dialect.py").read_text(), "run `make dialect`"


@pytest.mark.parametrize("message_id", STANDARD)
def test_standard_messages_are_the_standard_ones(message_id: int) -> None:
    ours, theirs = mav_dialect.mavlink_map[message_id], common.mavlink_map[message_id]
    assert ours.msgname == theirs.msgname
    assert ours.crc_extra == theirs.crc_extra
    assert ours.fieldnames == theirs.fieldnames
    assert ours.unpacker.format == theirs.unpacker.format
    assert ours.fieldunits_by_name == theirs.fieldunits_by_name


def entries(dialect: Any) -> dict[str, int]:
    return {entry.name: value for enum in dialect.enums.values() for value, entry in enum.items()}


def test_standard_enumerations_are_the_standard_ones() -> None:
    theirs = entries(common)
    ours = {
        name: value
        for name, value in entries(mav_dialect).items()
        if name.startswith("MAV_") and not name.endswith("_ENUM_END")
    }
    assert len(ours) > 20
    assert ours == {name: theirs[name] for name in ours}


def test_ours_collide_with_no_standard_message() -> None:
    ours = [message_id for message_id in CRC_EXTRA if message_id >= 52001]
    assert ours == list(range(52001, 52007))
    assert not set(ours) & set(common.mavlink_map)


def test_codec_knows_the_crc_extra_of_every_message() -> None:
    assert {key: message.crc_extra for key, message in mav_dialect.mavlink_map.items()} == CRC_EXTRA


def test_runtime_codec_needs_no_dialect_module() -> None:
    source = (
        "import sys, firmware_py.wire.mav_codec, firmware_py.wire.serial_link\n"
        "sys.exit(any('pymavlink' in name or 'mav_dialect' in name for name in sys.modules))"
    )
    assert (
        subprocess.run([sys.executable, "-c", source], cwd=WIRE.parents[1], check=False).returncode
        == 0
    )

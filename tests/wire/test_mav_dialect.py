"""The published dialect: generated from its XML, understood by ground stations, matched by our
codec."""

from __future__ import annotations

import contextlib
import importlib.util
import io
import shutil
import subprocess
import sys
import xml.etree.ElementTree as ET
from pathlib import Path
from typing import Any

import pytest
from pymavlink.dialects import v20
from pymavlink.dialects.v20 import common
from pymavlink.generator import mavgen, mavparse

from firmware_py.wire import mav_dialect
from firmware_py.wire.mav_packet import CRC_EXTRA

WIRE = Path(mav_dialect.__file__).parent
STOCK = Path(v20.__file__).parent
MAKE = Path(__file__).resolve().parents[2] / "deploy" / "make_dialect.py"
STANDARD = [message_id for message_id in CRC_EXTRA if message_id < 52001]


def test_generated_module_is_up_to_date(tmp_path: Path) -> None:
    fresh = tmp_path / "mav_dialect.py"
    subprocess.run([sys.executable, str(MAKE), str(fresh)], check=True)
    assert fresh.read_text() == (WIRE / "mav_dialect.py").read_text(), "run `make dialect`"


def test_the_dialect_with_the_whole_of_common_has_the_same_messages(tmp_path: Path) -> None:
    """As a ground station generates it."""
    for path in STOCK.glob("*.xml"):
        shutil.copy(path, tmp_path)
    shutil.copy(WIRE / "orbitd.xml", tmp_path)
    module = tmp_path / "orbitd_whole.py"
    options = mavgen.Opts(str(module), wire_protocol=mavparse.PROTOCOL_2_0, language="Python3")
    with contextlib.redirect_stdout(io.StringIO()):
        assert mavgen.mavgen(options, [str(tmp_path / "orbitd.xml")])
    spec = importlib.util.spec_from_file_location("orbitd_whole", module)
    assert spec
    assert spec.loader
    whole = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(whole)
    assert set(common.mavlink_map) <= set(whole.mavlink_map)
    for message_id, extra in CRC_EXTRA.items():
        assert whole.mavlink_map[message_id].crc_extra == extra


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
    assert ours == [*range(52001, 52007), *range(54001, 54010)]
    assert not set(ours) & set(common.mavlink_map)


def test_the_range_of_schema_2_is_free_in_every_published_dialect() -> None:
    ids = {
        int(message.get("id", "0"))
        for path in STOCK.glob("*.xml")
        for message in ET.parse(path).getroot().iterfind("messages/message")
    }
    assert len(ids) > 300
    assert not ids & set(range(54000, 54100))


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

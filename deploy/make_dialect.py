"""Generate ``firmware_py/wire/mav_dialect.py`` from ``orbitd.xml`` and the stock common dialect.

    python make_dialect.py [OUTPUT]

``orbitd.xml`` includes ``common.xml``, as ground stations want it; the whole of that is 30 000
lines of Python.  Here it is cut down to the messages that the device itself speaks, taken unchanged
from the XML files that pymavlink ships.
"""

from __future__ import annotations

import contextlib
import io
import shutil
import sys
import tempfile
import xml.etree.ElementTree as ET
from pathlib import Path

import pymavlink
from pymavlink.generator import mavgen, mavparse

WIRE = Path(__file__).resolve().parents[1] / "firmware_py" / "wire"
STOCK = Path(pymavlink.__file__).parent / "dialects" / "v20"
STOCK_FILES = ("minimal.xml", "standard.xml", "common.xml")

MESSAGES = (
    "HEARTBEAT",
    "SYSTEM_TIME",
    "PARAM_REQUEST_READ",
    "PARAM_REQUEST_LIST",
    "PARAM_VALUE",
    "PARAM_SET",
    "COMMAND_LONG",
    "COMMAND_ACK",
    "NAMED_VALUE_FLOAT",
    "STATUSTEXT",
)
ENUMS = ("MAV_MODE_FLAG", "MAV_STATE", "MAV_SEVERITY", "MAV_RESULT", "MAV_PARAM_TYPE")
ENTRIES = {
    "MAV_TYPE": ("MAV_TYPE_GENERIC", "MAV_TYPE_GCS", "MAV_TYPE_ONBOARD_CONTROLLER"),
    "MAV_AUTOPILOT": ("MAV_AUTOPILOT_GENERIC", "MAV_AUTOPILOT_INVALID"),
    "MAV_CMD": (
        "MAV_CMD_DO_SET_MODE",
        "MAV_CMD_COMPONENT_ARM_DISARM",
        "MAV_CMD_REQUEST_MESSAGE",
    ),
}
"""Of long enumerations the entries that are spoken."""


def cut_common() -> ET.ElementTree:
    """The stock definitions of :data:`MESSAGES`, :data:`ENUMS` and :data:`ENTRIES`."""
    root = ET.Element("mavlink")
    ET.SubElement(root, "version").text = "3"
    enums, messages = ET.SubElement(root, "enums"), ET.SubElement(root, "messages")
    cut = {name: ET.SubElement(enums, "enum", name=name) for name in ENTRIES}
    for name in STOCK_FILES:
        stock = ET.parse(STOCK / name).getroot()
        for enum in stock.iterfind("enums/enum"):
            known = enum.get("name", "")
            if known in ENUMS:
                enums.append(enum)
            elif known in ENTRIES:
                entries = enum.iterfind("entry")
                cut[known].extend(e for e in entries if e.get("name") in ENTRIES[known])
        messages.extend(m for m in stock.iterfind("messages/message") if m.get("name") in MESSAGES)
    return ET.ElementTree(root)


def make(output: Path) -> None:
    """Write the module to ``output``."""
    with tempfile.TemporaryDirectory() as folder:
        shutil.copy(WIRE / "orbitd.xml", folder)
        cut_common().write(Path(folder) / "common.xml")
        options = mavgen.Opts(str(output), wire_protocol=mavparse.PROTOCOL_2_0, language="Python3")
        with contextlib.redirect_stdout(io.StringIO()):
            if not mavgen.mavgen(options, [str(Path(folder) / "orbitd.xml")]):
                raise SystemExit("mavgen refused orbitd.xml; see its messages above")


if __name__ == "__main__":
    make(Path(sys.argv[1]) if len(sys.argv) > 1 else WIRE / "mav_dialect.py")

"""``orbitd migrate OLD.toml FOLDER``: makes a rig folder of a configuration of the first schema.

The old file stays as it is, its remarks are kept; what cannot be read without a fault is refused,
and FOLDER is there whole or not at all.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from firmware_py import launch
from firmware_py.config.source import read_file, shown
from firmware_py.config.written import FolderError, rig_texts, write_rig


def main(argv: list[str]) -> int:
    """Read the old file as the processes do, write the folder, and say where it is."""
    parser = argparse.ArgumentParser(prog="orbitd migrate", description=__doc__)
    parser.add_argument("old", type=Path, metavar="OLD.toml", help="file of the first schema")
    parser.add_argument("folder", type=Path, metavar="FOLDER", help="rig folder to make")
    options = parser.parse_args(argv)
    texts = migrated(options.old)
    write_rig(texts, options.folder)
    print(f"{shown(str(options.folder))}: made of {shown(options.old.name)}")
    print(f"next: orbitd check {shown(str(options.folder))}")
    return 0


def migrated(old: Path) -> dict[str, str]:
    """The files of the rig folder that says what ``old`` says.

    Raises
    ------
    ConfigError, FolderError
        ``old`` has faults, or is a rig folder already.
    """
    if old.is_dir():
        raise FolderError(f"{old}: is a folder, not a file of the first schema; it needs no change")
    config, _ = launch.verified(old)
    return rig_texts(config, read_file(old))

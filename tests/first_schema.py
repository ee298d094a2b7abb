"""Configurations of the first schema, one file for machine and device, as people still have
them."""

from __future__ import annotations

from pathlib import Path

FOLDER = Path(__file__).parent / "config" / "first_schema"
BENCH_FILE = FOLDER / "bench.toml"
BENCH = BENCH_FILE.read_text(encoding="utf-8")
SEED_FILE = FOLDER / "seed.toml"

"""Sleeps a millisecond, again and again, until standard input ends; tells the longest stall in
seconds: what this machine withheld from a process that wants next to nothing."""

from __future__ import annotations

import select
import sys
import time


def main() -> None:
    worst_s, before_s = 0.0, time.monotonic()
    while not select.select([sys.stdin], [], [], 0.001)[0]:
        now_s = time.monotonic()
        worst_s, before_s = max(worst_s, now_s - before_s), now_s
    print(worst_s)


if __name__ == "__main__":
    main()

"""Round trips of a frame on the bus: `echo_client.py pong` bounces what `echo_client.py ping`
sends.

    python echo_client.py ping|pong [CHANNEL [COUNT]]

`ping` prints median, 99th percentile and maximum in milliseconds as one JSON object; `pong` ends
after ten seconds of silence.
"""

import json
import sys
import time

import can

PING, PONG = 0x700, 0x701
role, channel, count = [*sys.argv[1:], *["ping", "orbitd0", "1000"][len(sys.argv) - 1 :]]


def bounce(bus: can.BusABC) -> None:
    while (frame := bus.recv(10.0)) is not None:
        frame.arbitration_id = PONG
        bus.send(frame)


def round_trip_ms(bus: can.BusABC) -> float | None:
    stamp = time.monotonic_ns().to_bytes(8, "little")
    bus.send(
        can.Message(
            arbitration_id=PING, is_extended_id=False, is_fd=True, bitrate_switch=True, data=stamp
        )
    )
    while (answer := bus.recv(1.0)) is not None and answer.data != stamp:
        pass  # an answer that came too late for its own ping
    return (time.monotonic_ns() - int.from_bytes(stamp, "little")) * 1e-6 if answer else None


def measure(bus: can.BusABC) -> None:
    trips = []
    for _ in range(int(count)):
        trips.append(round_trip_ms(bus))
        time.sleep(0.001)
    answered = sorted(trip for trip in trips if trip is not None)
    at = {
        name: answered[int(share * (len(answered) - 1))] if answered else None
        for name, share in (("p50", 0.5), ("p99", 0.99), ("max", 1.0))
    }
    print(json.dumps({"sent": len(trips), "answered": len(answered), **at}))


with can.Bus(channel=channel, interface="orbitd_hub", fd=True) as bus:
    bus.set_filters(
        [{"can_id": PING if role == "pong" else PONG, "can_mask": 0x7FF, "extended": False}]
    )
    bounce(bus) if role == "pong" else measure(bus)

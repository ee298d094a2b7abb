"""Prints the live diagnosis. Usage: zenoh_diagnosis.py
unixsock-stream//run/orbitd/default/zenoh.sock"""

import json
import sys

import zenoh

config = zenoh.Config.from_json5(
    json.dumps({"mode": "client", "connect": {"endpoints": sys.argv[1:]}})
)
with (
    zenoh.open(config) as session,
    session.declare_subscriber("orbitd/*/*/ha/diagnosis") as diagnoses,
):
    for sample in diagnoses:
        said = json.loads(sample.payload.to_string())
        print(f"{said['verdict']:<32} {100 * said['probability']:5.1f} %", flush=True)

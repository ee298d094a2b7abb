#!/bin/bash
# CanLink and the example programs on real SocketCAN, on a machine whose own kernel has no CAN: boots
# Debian's user-mode-linux kernel on the host's root file system (read only), loads can, can-raw and vcan,
# and runs job.py inside. About 30 s.
#
#   deploy/socketcan_test/run.sh        root; needs linux.uml and its modules (Debian: user-mode-linux)
#   UML_ROOT=DIR run.sh                 where that package was unpacked to, if it is not installed
#
# Exit code 0: passed, 1: failed, 77: cannot run here.
set -u
here=$(cd "$(dirname "$0")" && pwd)
root=${UML_ROOT:-}
kernel=$root/usr/bin/linux.uml
modules=$(echo "$root"/usr/lib/uml/modules/*/kernel)
log=$(mktemp)
trap 'rm -f "$log"' EXIT

if [ ! -x "$kernel" ] || [ ! -d "$modules" ]; then
    echo "no $kernel with modules; install user-mode-linux, or unpack it and set UML_ROOT" >&2
    exit 77
fi
if grep -q amx_tile /proc/cpuinfo; then
    echo "this processor has AMX, on which the stock user-mode-linux panics" >&2
    exit 77
fi
timeout 150 "$kernel" mem=768M root=/dev/root rootfstype=hostfs rootflags=/ ro init="$here/init.sh" \
    con0=fd:0,fd:1 con=null quiet MODULES="$modules" JOB="$here/job.py" PYTHON="$here/../../.venv/bin/python" \
    </dev/null 2>&1 | tee "$log"
grep -q "^socketcan test: passed" "$log"

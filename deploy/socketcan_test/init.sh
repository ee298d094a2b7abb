#!/bin/bash
# First process inside user-mode-linux: MODULES, JOB and PYTHON come from the kernel's command line.
export PATH=/usr/sbin:/usr/bin:/sbin:/bin HOME=/root PYTHONDONTWRITEBYTECODE=1 OMP_NUM_THREADS=1
mount -t proc proc /proc
mount -t sysfs sys /sys
mount -t tmpfs tmpfs /run
cd /run || exit 1
for module in drivers/net/can/dev/can-dev net/can/can net/can/can-raw drivers/net/can/vcan; do
    # as insmod does; minimal systems have none
    "$PYTHON" -c 'import ctypes, os, sys
if ctypes.CDLL(None).syscall(313, os.open(sys.argv[1], os.O_RDONLY), b"", 0):  # finit_module on x86-64
    sys.exit("cannot load " + sys.argv[1])' "$MODULES/$module.ko"
done
ip link set lo up
ip link add vcan0 type vcan
ip link set vcan0 mtu 72 up
timeout 120 "$PYTHON" "$JOB"
echo o > /proc/sysrq-trigger
sleep 5

#!/usr/bin/env bash
# Boots a real systemd in a container, installs orbitd there from its wheel as deploy/SERVICE.md says, runs it
# against the rig in software, kills and hangs its processes, and prints one line per check. Root only; about
# four minutes. The root and the wheels of other packages are kept in ~/.cache/orbitd.
set -euo pipefail
here=$(cd "$(dirname "$0")" && pwd)
repo=$(cd "$here/../.." && pwd)
cache=${XDG_CACHE_HOME:-$HOME/.cache}/orbitd
python=${PYTHON:-$repo/.venv/bin/python}
root=$cache/systemd-root-1
packages=systemd,systemd-sysv,dbus,python3,python3-venv,iproute2

fail() { echo "test-systemd: $1" >&2; exit 2; }
[ "$(id -u)" = 0 ] || fail "needs root: systemd-nspawn mounts and boots a container"
for tool in systemd-nspawn mmdebstrap unshare; do
    command -v $tool >/dev/null || fail "$tool is missing: apt-get install systemd-container mmdebstrap"
done

if [ ! -e "$root.complete" ]; then
    echo "test-systemd: building the root, once"
    rm -rf "$root"; mkdir -p "$cache"
    mmdebstrap --quiet --variant=minbase --include=$packages bookworm "$root"
    touch "$root.complete"
fi

share=$(mktemp -d)
boot=
finish() {
    [ -z "$boot" ] || { kill "$boot" 2>/dev/null && wait "$boot"; } || true
    rm -rf "$share"
}
trap finish EXIT
echo "test-systemd: building the wheel"
rm -rf "$repo/build"
"$python" -m pip wheel --quiet --no-deps -w "$share" "$repo"
rm -rf "$repo/build"
wheel=$(ls "$share"/orbitd-*.whl)

wheels=$cache/wheels-$(cat "$repo/pyproject.toml" "$repo/constraints.txt" | sha256sum | cut -c1-12)
if [ ! -e "$wheels/.complete" ]; then
    echo "test-systemd: gathering what it needs, once per lock file"
    rm -rf "$cache"/wheels*; mkdir -p "$wheels"
    "$python" -m pip download --quiet --dest "$wheels" --python-version 3.11 --only-binary=:all: \
        -c "$repo/constraints.txt" "$wheel[sim]"
    rm "$wheels"/orbitd-*.whl
    touch "$wheels/.complete"
fi

cp "$here/inside.py" "$repo/constraints.txt" "$repo/deploy/SERVICE.md" "$share/"
cat > "$share/orbitd-test.unit" <<'UNIT'
[Unit]
Description=test of the service
After=multi-user.target
SuccessAction=poweroff-force
FailureAction=poweroff-force
[Service]
Type=oneshot
WorkingDirectory=/mnt/host
Environment=PIP_NO_INDEX=1 PIP_FIND_LINKS=/mnt/wheels PIP_DISABLE_PIP_VERSION_CHECK=1 PYTHONUNBUFFERED=1
ExecStart=/usr/bin/python3 /mnt/host/inside.py
StandardOutput=file:/mnt/host/output.txt
StandardError=inherit
TimeoutStartSec=560
UNIT

echo "test-systemd: booting"
touch "$share/output.txt"
timeout 600 unshare -m sh -c "
    mount -t tmpfs tmpfs /run; mkdir -p /run/lock
    exec systemd-nspawn -q -D '$root' --volatile=overlay --register=no --keep-unit --boot --private-network \
        --bind='$share:/mnt/host' --bind-ro='$wheels:/mnt/wheels' \
        --bind-ro='$share/orbitd-test.unit:/etc/systemd/system/test.service' \
        -- systemd.wants=test.service" > "$share/console.txt" 2>&1 </dev/null &
boot=$!
tail --pid="$boot" -n +1 -f "$share/output.txt"
wait "$boot" || true
[ -s "$share/output.txt" ] || { tail -40 "$share/console.txt"; fail "the container wrote no result"; }
grep -q '^result: all passed$' "$share/output.txt"

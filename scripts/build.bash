#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# colcon build, unless nothing changed since the last one: colcon needs seconds to find that out.
set -euo pipefail

bev_preheat_root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd -P)
cd "$bev_preheat_root"

# Two "make" at once would build in the same folders.
if command -v flock >/dev/null; then
    exec 9<"${BASH_SOURCE[0]}"
    flock 9
fi

# From a shell that has sourced scripts/env.bash the install space would be its own underlay.
for variable in PATH AMENT_PREFIX_PATH CMAKE_PREFIX_PATH COLCON_PREFIX_PATH LD_LIBRARY_PATH PYTHONPATH; do
    [ -n "${!variable:-}" ] || continue
    kept=$(printf '%s\n' "${!variable}" | tr ':' '\n' | grep -v "^$bev_preheat_root/install\(/\|$\)" | paste -s -d : -) || true
    if [ -n "$kept" ]; then export "$variable=$kept"; else unset "$variable"; fi
done

# shellcheck source=scripts/ros_underlay.bash
. scripts/ros_underlay.bash
bev_preheat_enter
if [ -z "$bev_preheat_underlay" ]; then
    echo "build: no ROS 2 here yet; run: make setup" >&2
    exit 1
fi

# What the last build was made of: a stamp for make, and the list of names that tells which have gone since.
sources=(package.xml setup.py setup.cfg bev_preheat config resource msg_defs)
[ ! -d launch ] || sources+=(launch)
state=$(
    echo "underlay $bev_preheat_underlay $bev_preheat_root $(command -v python3) $(cat .venv/.ready 2>/dev/null || true)"
    find "${sources[@]}" -name __pycache__ -prune -o -type f -printf '%p %s %T@\n' | sort
)
stamp=install/.built
if [ "$(cat "$stamp" 2>/dev/null)" = "$state" ]; then
    exit 0
fi

# colcon and setuptools only add: a module or message that was renamed would stay importable for ever.
names() { cut -d ' ' -f 1 | sort; }
if [ -e "$stamp" ] && [ -n "$(comm -23 <(names <"$stamp") <(names <<<"$state"))" ]; then
    rm -rf build install
fi

rm -f "$stamp"
colcon build --base-paths . msg_defs "$@"
printf '%s\n' "$state" >"$stamp"

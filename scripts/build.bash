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

# shellcheck source=scripts/ros_underlay.bash
. scripts/ros_underlay.bash

# From a shell that has sourced scripts/env.bash the install space would be its own underlay.
for variable in PATH AMENT_PREFIX_PATH CMAKE_PREFIX_PATH COLCON_PREFIX_PATH LD_LIBRARY_PATH PYTHONPATH; do
    [ -n "${!variable:-}" ] || continue
    kept=$(printf '%s\n' "${!variable}" | tr ':' '\n' | grep -v "^$bev_preheat_place/install\(/\|$\)" | paste -s -d : -) || true
    if [ -n "$kept" ]; then export "$variable=$kept"; else unset "$variable"; fi
done

bev_preheat_enter build
if [ "$(bev_preheat_venv_state build)" != ready ]; then
    echo "build: .venv is $(bev_preheat_venv_state build); run: make setup" >&2
    exit 1
fi
install=$bev_preheat_place/install
build=$bev_preheat_place/build

# Identity of the last build: a stamp for make, and the list of names that shows which files have gone since.
made_with="with $bev_preheat_underlay $(tr '\n' ' ' <"$bev_preheat_place/.venv/.ready")"
# As setup.py reads it.
case ${BEV_PREHEAT_WITHOUT_STUDIES:-0} in 0) ;; *) made_with+='without studies' ;; esac
sources=(package.xml setup.py setup.cfg colcon.pkg bev_preheat studies config core launch resource msg_defs)
state=$(
    echo "$made_with"
    find "${sources[@]}" -name __pycache__ -prune -o -type f -printf '%p %s %T@\n' | sort
)
stamp=$install/.built
if [ "$(cat "$stamp" 2>/dev/null)" = "$state" ]; then
    exit 0
fi

# colcon and setuptools only add: a module or message that was renamed would stay importable for ever. CMake keeps the
# paths of another place or Python.
names() { sed 1d | cut -d ' ' -f 1 | sort; }
if [ -e "$stamp" ]; then
    if [ "$(head -n 1 "$stamp")" != "$made_with" ] || [ -n "$(comm -23 <(names <"$stamp") <(names <<<"$state"))" ]; then
        rm -rf "$build" "$install"
    fi
elif [ -d "$build" ]; then
    # An interrupted build, which may have been another place's or Python's.
    rm -rf "$build" "$install"
fi

rm -f "$stamp"
# Without byte-compiled files (as in many containers), each start of a node would compile all modules again.
unset PYTHONDONTWRITEBYTECODE
# Without a distribution there is nothing that could use the messages from C++ (msg_defs/CMakeLists.txt).
[ "$bev_preheat_underlay" != .venv ] || export BEV_PREHEAT_PYTHON_MESSAGES_ONLY=1
# colcon's own choice compiles less at once on a loaded computer, as it is while setup installs packages.
MAKEFLAGS=-j$(nproc)
export MAKEFLAGS
# With this Python, so that the installed executables run with it and see its packages.
python3 -c 'import sys; from colcon_core.command import main; sys.exit(main())' --log-base "$bev_preheat_place/log" \
    build --base-paths . core msg_defs --build-base "$build" --install-base "$install" "$@"
printf '%s\n' "$state" >"$stamp"

#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Makes the working environment, once. With a ROS 2 distribution: checks that nothing is missing and says
# what installs it. Without: ROS 2 Jazzy from wheels in .venv. "setup.bash bench" adds the benchmark's own.
set -euo pipefail

bev_preheat_root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd -P)
cd "$bev_preheat_root"
venv=$bev_preheat_root/.venv

say() { printf 'setup: %s\n' "$*"; }
fail() {
    printf 'setup: %s\n' "$@" >&2
    exit 1
}

# Two "make" at once would install over each other. The lock is this file, so nothing is left behind.
if command -v flock >/dev/null; then
    exec 9<"${BASH_SOURCE[0]}"
    flock 9
fi

# --- a ROS 2 distribution: look, never install ---

missing_modules() {
    python3 - "$@" <<'PYTHON'
import importlib.util
import sys

print(*(name for name in sys.argv[1:] if importlib.util.find_spec(name) is None))
PYTHON
}

# The rosdep keys of package.xml are the modules' names, but for python3- in front and -pip behind.
needed_modules() {
    sed -nE 's/.*<(exec_|test_|build_)?depend>(python3-)?([a-z0-9_-]+)<.*/\3/p' package.xml |
        sed -e 's/-pip$//' -e '/^bev_preheat_msgs$/d' | tr - _
}

check_distribution() {
    python3 -c 'import sys; sys.exit(sys.version_info < (3, 11))' ||
        fail "ROS 2 ${ROS_DISTRO:-} in $bev_preheat_underlay uses $(python3 --version), this project needs 3.11 or newer: ROS 2 Jazzy."
    local missing
    # shellcheck disable=SC2046
    missing=$(missing_modules rosidl_generator_py $(needed_modules))
    command -v colcon >/dev/null || missing="$missing colcon"
    if [ -n "$missing" ]; then
        fail "ROS 2 ${ROS_DISTRO:-} in $bev_preheat_underlay is used; missing: $missing" \
            "  this installs them: rosdep install --from-paths . msg_defs --ignore-src -y" \
            "  (colcon itself: sudo apt install python3-colcon-common-extensions)"
    fi
    say "using ROS 2 ${ROS_DISTRO:-} in $bev_preheat_underlay"
    missing=$(missing_modules casadi)
    if [ -n "$missing" ]; then
        say "casadi is missing, which only the optimum and its comparison need:" \
            "python3 -m pip install --user --break-system-packages $(grep '^casadi==' scripts/requirements.txt)"
    fi
}

check_distribution_for_benchmark() {
    local missing
    missing=$(missing_modules casadi do_mpc)
    [ -z "$missing" ] || fail "the benchmark lacks: $missing" \
        "  this installs them: python3 -m pip install --user --break-system-packages" \
        "    $(grep '^casadi==' scripts/requirements.txt) $(grep '^do-mpc==' scripts/requirements-bench.txt)"
}

# --- no distribution: .venv ---

find_python() {
    local candidate
    for candidate in ${PYTHON:-python3 python3.12 python3.11 python3.13}; do
        if "$candidate" -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null; then
            command -v "$candidate"
            return
        fi
    done
    fail "needs Python 3.11 or newer; ${PYTHON:-python3} is $("${PYTHON:-python3}" --version 2>/dev/null || echo not there)" \
        "  install one (Debian, Ubuntu: python3.12 python3.12-venv python3.12-dev) or name it: make setup PYTHON=/path/to/python3.12"
}

check_build_tools() {
    local tool
    for tool in cc c++ make; do
        command -v "$tool" >/dev/null ||
            fail "the messages are compiled, and $tool is not there (Debian, Ubuntu: sudo apt install build-essential)"
    done
    "$1" -c 'import os, sysconfig; os.stat(os.path.join(sysconfig.get_path("include"), "Python.h"))' 2>/dev/null ||
        fail "the messages are compiled against Python, and $1 has no Python.h (Debian, Ubuntu: sudo apt install python3-dev)"
}

version_of() { "$1" -I -S -c 'import sys; print(*sys.version_info[:3], sep=".")' 2>/dev/null; }

# What .ready must say: the place too, because a virtual environment does not survive being moved.
stamp_for() { printf '%s %s %s\n' "$(version_of "$1")" "$(cksum <scripts/requirements.txt)" "$venv"; }

install_wheels() {
    local log=$venv/install.log
    if ! "$venv/bin/python" -m pip install --no-deps --no-input --disable-pip-version-check --progress-bar off \
        -r "$1" 2>&1 | tee "$log" |
        awk -v all="$(grep -c '==' "$1")" '
            /^Collecting |^Processing / { n++; if (n % 40 == 0) { print "setup:   " n " of " all; fflush() } }
            /^Installing collected/ { print "setup:   unpacking"; fflush() }'; then
        tail -n 15 "$log" >&2
        fail "pip could not install $1 (all of its output: $log). The ROS wheels are for Linux on x86-64, glibc 2.28 or newer." \
            "  Then run setup again."
    fi
}

# The CMake files inside the message wheels name folders of the machine that built them.
mend_cmake_files() {
    "$venv/bin/python" - "$venv" <<'PYTHON'
import pathlib
import re
import sys
import sysconfig

import numpy

include = sysconfig.get_path('include')
for path in pathlib.Path(sys.argv[1]).glob('share/*/cmake/*.cmake'):
    text = path.read_text()
    mended = re.sub(r'/opt/python/[^/;"]+/lib/python3\.\d+/site-packages/numpy/_core/include',
                    lambda _: numpy.get_include(), text)
    mended = re.sub(r'/opt/python/[^/;"]+/include/python3\.\d+', lambda _: include, mended)
    if mended != text:
        path.write_text(mended)
PYTHON
}

# As every ROS prefix has it: colcon's install/setup.bash reads it, so that alone is enough to work.
# Not bin/activate: that one changes the prompt and makes PATH longer each time.
write_local_setup() {
    local shell
    for shell in sh bash zsh; do
        cat >"$venv/local_setup.$shell" <<SH
# Written by scripts/setup.bash.
export VIRTUAL_ENV='$venv'
case ":\$PATH:" in *":\$VIRTUAL_ENV/bin:"*) ;; *) export PATH="\$VIRTUAL_ENV/bin:\$PATH" ;; esac
case ":\${AMENT_PREFIX_PATH:-}:" in *":\$VIRTUAL_ENV:"*) ;; *) export AMENT_PREFIX_PATH="\${AMENT_PREFIX_PATH:+\$AMENT_PREFIX_PATH:}\$VIRTUAL_ENV" ;; esac
case ":\${CMAKE_PREFIX_PATH:-}:" in *":\$VIRTUAL_ENV:"*) ;; *) export CMAKE_PREFIX_PATH="\${CMAKE_PREFIX_PATH:+\$CMAKE_PREFIX_PATH:}\$VIRTUAL_ENV" ;; esac
SH
    done
}

make_venv() {
    local python=$venv/bin/python
    # Without PYTHON the one that .venv was made with stays: a later "make" must not switch back to python3.
    if [ -x "$python" ] && { [ -z "${PYTHON:-}" ] || [ "$(version_of "$PYTHON")" = "$(version_of "$python")" ]; }; then
        if [ "$(cat "$venv/.ready" 2>/dev/null)" = "$(stamp_for "$python")" ]; then
            return
        fi
    fi
    local base
    base=$(find_python)
    check_build_tools "$base"
    local wanted
    wanted=$(version_of "$base")
    say "ROS 2 Jazzy and what else is needed go into .venv, with Python $wanted"
    rm -f "$venv/.ready"
    # Built anew rather than upgraded: what an older requirements.txt installed must not stay and help.
    "$base" -m venv --clear "$venv" ||
        fail "$base cannot make a virtual environment (Debian, Ubuntu: sudo apt install python3-venv)"
    say "downloading and installing $(grep -c '==' scripts/requirements.txt) packages, a minute or two"
    install_wheels scripts/requirements.txt
    mend_cmake_files
    write_local_setup
    stamp_for "$python" >"$venv/.ready.new"
    mv "$venv/.ready.new" "$venv/.ready"
    say "done in $SECONDS s"
}

add_benchmark() {
    local stamp
    stamp=$(cksum <scripts/requirements-bench.txt)
    if [ "$(cat "$venv/.ready-bench" 2>/dev/null)" != "$stamp" ]; then
        say "adding the benchmark's packages to .venv"
        install_wheels scripts/requirements-bench.txt
        printf '%s\n' "$stamp" >"$venv/.ready-bench"
    fi
}

# shellcheck source=scripts/ros_underlay.bash
. scripts/ros_underlay.bash
bev_preheat_enter_distribution
if [ -n "$bev_preheat_underlay" ]; then
    check_distribution
    [ "${1:-}" != bench ] || check_distribution_for_benchmark
else
    # In a shell that has sourced scripts/env.bash python3 is .venv's own, which is about to be replaced.
    PATH=:$PATH:
    PATH=${PATH//":$venv/bin:"/:}
    PATH=${PATH#:}
    PATH=${PATH%:}
    make_venv
    [ "${1:-}" != bench ] || add_benchmark
fi

#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Make the working environment in .venv, once. With a ROS 2 distribution: the packages missing there. Without:
# ROS 2 Jazzy from wheels. "setup.bash bench" adds the packages needed only by make bench; likewise docs, footprint and lint. With
# BEV_PREHEAT_OLDEST=1: the oldest supported versions and no optional package, in .oldest/.venv.
set -euo pipefail

bev_preheat_root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd -P)
cd "$bev_preheat_root"

say() { printf 'setup: %s\n' "$*"; }
fail() {
    printf 'setup: %s\n' "$@" >&2
    exit 1
}

# CMake takes a path apart at such characters, rosidl loses other letters than ASCII's.
if printf '%s' "$bev_preheat_root" | LC_ALL=C grep -q '[^A-Za-z0-9/._+@,=~-]'; then
    fail "ROS 2 cannot build in $bev_preheat_root: a path may only have ASCII letters, digits and . _ + - @ , = ~, no space; move the checkout"
fi

# Two "make" at once would install over each other. The lock is this file, so nothing is left behind.
if command -v flock >/dev/null; then
    exec 9<"${BASH_SOURCE[0]}"
    flock -n 9 || { say "waits for another setup of this checkout" && flock 9; }
fi

# shellcheck source=scripts/ros_underlay.bash
. scripts/ros_underlay.bash
venv=$bev_preheat_place/.venv
python=$venv/bin/python
# As it is said: .venv or .oldest/.venv.
venv_name=${venv#"$bev_preheat_root/"}

# --- found environment ---

version_of() { "$1" -I -S -c 'import sys; print(*sys.version_info[:3], sep=".")' 2>/dev/null; }

# The supported versions, and the oldest.
pythons=$(cat scripts/pythons.txt)
oldest_python=${pythons%%$'\n'*}

is_new_enough() {
    "$1" -c 'import sys; sys.exit(sys.version_info[:2] < tuple(map(int, sys.argv[1].split("."))))' "$oldest_python" 2>/dev/null
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

# The distribution's Python must be able to load its rclpy; another Python may come first in PATH.
find_distribution_python() {
    local candidate
    for candidate in ${PYTHON:-python3 /usr/bin/python3}; do
        if "$candidate" -c 'import rclpy' 2>/dev/null; then
            is_new_enough "$candidate" ||
                fail "ROS 2 ${ROS_DISTRO:-} in $bev_preheat_underlay uses $("$candidate" --version); this project needs ROS 2 Jazzy, with Python $oldest_python or newer"
            command -v "$candidate"
            return
        fi
    done
    fail "ROS 2 ${ROS_DISTRO:-} in $bev_preheat_underlay is used, but ${PYTHON:-python3} cannot import its rclpy: $("${PYTHON:-python3}" -c 'import rclpy' 2>&1 | tail -n 1)"
}

# The dependencies of package.xml that are ROS packages are the keys without python3- and the like.
check_distribution() {
    local missing
    # shellcheck disable=SC2046
    missing=$("$1" - rosidl_generator_py \
        $(sed -nE 's/.*<exec_depend>([a-z_]+)<.*/\1/p' package.xml | grep -vE '^bev_preheat_(core|msgs)$') <<'PYTHON'
import importlib.util
import sys

print(*(name for name in sys.argv[1:] if importlib.util.find_spec(name) is None))
PYTHON
    )
    [ -z "$missing" ] ||
        fail "ROS 2 ${ROS_DISTRO:-} in $bev_preheat_underlay lacks: $missing; install: rosdep install --from-paths . core msg_defs --ignore-src -y"
    command -v cmake >/dev/null || fail "the messages are compiled, and cmake is not there (sudo apt install cmake)"
}

find_python() {
    local candidate candidates="python3 ${pythons//3./python3.}"
    # The last Python with wheels of all oldest versions is the oldest supported one.
    [ -z "${BEV_PREHEAT_OLDEST:-}" ] || candidates="${pythons//3./python3.} python3"
    for candidate in ${PYTHON:-$candidates}; do
        if is_new_enough "$candidate"; then
            command -v "$candidate"
            return
        fi
    done
    fail "needs Python $oldest_python or newer; ${PYTHON:-python3} is $("${PYTHON:-python3}" --version 2>/dev/null || echo not there)" \
        "  install one (Debian, Ubuntu: python3.12 python3.12-venv python3.12-dev) or name it: make setup PYTHON=/path/to/python3.12"
}

# --- pip ---

install_packages() {
    local log=$venv/install.log
    if ! "$python" -m pip install --no-input --disable-pip-version-check --progress-bar off "$@" 2>&1 | tee "$log" |
        awk '/^Collecting |^Processing / { n++; if (n % 40 == 0) { print "setup:   " n " packages"; fflush() } }
            /^Installing collected/ { print "setup:   unpacking"; fflush() }'; then
        tail -n 15 "$log" >&2
        fail "pip could not install what is needed (all of its output: $log). Then run setup again." \
            "  The ROS wheels are for Linux on x86-64, glibc 2.28 or newer; elsewhere use a ROS 2 distribution."
    fi
}

# With a virtual environment that sees the system's packages, the system's pip will do.
ensure_pip() {
    "$python" -m pip --version >/dev/null 2>&1 || "$python" -m ensurepip >/dev/null 2>&1 ||
        fail "there is no pip (Debian, Ubuntu: sudo apt install python3-venv)"
}

wheels() {
    if [ -n "${BEV_PREHEAT_OLDEST:-}" ]; then
        # requirements.txt, but for the packages that the list of the oldest names.
        awk -F '==' 'FNR == NR { if (NF > 1) { named[$1] } ; next } NF > 1 && !($1 in named)' \
            scripts/requirements-oldest.txt scripts/requirements.txt
        grep '==' scripts/requirements-oldest.txt
    else
        grep -h '==' scripts/requirements.txt scripts/requirements-optional.txt scripts/requirements-wheels.txt
    fi
}

# The CMake files inside the message wheels name folders of the machine that built them.
mend_cmake_files() {
    "$python" - "$venv" <<'PYTHON'
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

# --- .venv ---

# What .ready must say: the place too, because a virtual environment does not survive being moved.
stamp_for() {
    printf '%s\n' "$venv" "$(version_of "$1") ${bev_preheat_underlay:-wheels} $(cat scripts/requirements*.txt | cksum)"
}

is_ready() {
    # Without PYTHON, keep the Python of .venv: a later "make" must not switch back to python3.
    [ -x "$python" ] && { [ -z "${PYTHON:-}" ] || [ "$(version_of "$PYTHON")" = "$(version_of "$python")" ]; } &&
        [ "$(cat "$venv/.ready" 2>/dev/null)" = "$(stamp_for "$python")" ]
}

say_why_again() {
    case $(bev_preheat_venv_state) in
        unfinished) say "the previous setup was interrupted or has failed; rebuilding $venv_name" ;;
        moved) say "the checkout was moved or copied; rebuilding $venv_name" ;;
    esac
}

# A half-made .venv never counts as ready: .ready is removed first and written last.
begin() {
    say_why_again
    trap 'trap - INT TERM; echo; say "interrupted; $venv_name is incomplete. The next make or scripts/setup.bash starts again." >&2; exit 130' INT TERM
    rm -f "$venv/.ready"
}

finish() {
    write_local_setup
    stamp_for "$python" >"$venv/.ready.new"
    mv "$venv/.ready.new" "$venv/.ready"
    trap - INT TERM
    say "done in $SECONDS s"
}

# What Python says of an interruption is left out.
make_venv() {
    local problem
    problem=$("$1" -m venv "${@:2}" "$venv" 2>&1) ||
        fail "$1 cannot make a virtual environment: $(tail -n 1 <<<"$problem") (Debian, Ubuntu: sudo apt install python3-venv)"
}

make_venv_of_wheels() {
    ! is_ready || return 0
    local base
    base=$(find_python)
    check_build_tools "$base"
    begin
    say "ROS 2 Jazzy and what else is needed go into $venv_name, with Python $(version_of "$base")"
    # Rebuilt rather than upgraded: packages of an older requirements.txt must not remain.
    make_venv "$base" --clear
    wheels >"$venv/requirements.txt"
    say "downloading and installing $(wc -l <"$venv/requirements.txt") packages, a minute or two"
    install_packages --no-deps -r "$venv/requirements.txt"
    mend_cmake_files
    finish
}

make_venv_of_distribution() {
    # The system's packages may have changed since.
    if is_ready && [ -z "$("$python" scripts/lacking_packages.py)" ]; then
        return 0
    fi
    local base lacking
    base=$(find_distribution_python)
    check_build_tools "$base"
    check_distribution "$base"
    say "using ROS 2 ${ROS_DISTRO:-} in $bev_preheat_underlay"
    begin
    make_venv "$base" --clear --without-pip --system-site-packages
    lacking=$("$python" scripts/lacking_packages.py)
    if [ -n "$lacking" ]; then
        # shellcheck disable=SC2086
        say "installing the packages that the system is missing into .venv:" $lacking
        add_to_distribution
    fi
    finish
}

add_to_distribution() {
    ensure_pip
    "$python" scripts/lacking_packages.py "$@" >"$venv/requirements.txt"
    "$python" scripts/lacking_packages.py --constraints "$@" >"$venv/constraints.txt"
    install_packages -r "$venv/requirements.txt" -c "$venv/constraints.txt"
}

# What only one target of the Makefile needs: scripts/requirements-GROUP.txt.
add_group() {
    local file=scripts/requirements-$1.txt stamp
    [ -f "$file" ] || fail "unknown group $1; usage: scripts/setup.bash [bench | docs | footprint | lint]"
    stamp=$(cksum <"$file")
    if [ "$(cat "$venv/.ready-$1" 2>/dev/null)" != "$stamp" ]; then
        say "adding the packages of make $1 to $venv_name"
        if [ -n "$bev_preheat_underlay" ]; then
            add_to_distribution --group "$1"
        else
            install_packages --no-deps -r "$file"
        fi
        printf '%s\n' "$stamp" >"$venv/.ready-$1"
    fi
}

bev_preheat_enter_distribution
# In a shell that has sourced scripts/env.bash python3 is .venv's own, which is about to be replaced.
PATH=:$PATH:
PATH=${PATH//":$venv/bin:"/:}
PATH=${PATH#:}
PATH=${PATH%:}
if [ -n "$bev_preheat_underlay" ]; then
    make_venv_of_distribution
else
    make_venv_of_wheels
fi
[ -z "${1:-}" ] || add_group "$1"

#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# usage: setup.bash [--build] [GROUP ...]
# Make the working environment in .venv, once. With a ROS 2 distribution: the packages missing there. Without:
# ROS 2 Jazzy from wheels. The packages come in groups: builds need requirements.txt, the program also the group demo;
# "setup.bash bus logs" adds the groups bus and logs (requirements-optional.txt, requirements-GROUP.txt). --build runs
# build.bash while packages are installed.
# BEV_PREHEAT_ENVIRONMENT names another environment, in .environments/NAME: oldest has the oldest supported versions and
# no optional package (requirements-oldest.txt), kilted the wheels of ROS 2 Kilted (requirements-kilted.txt); any other
# name has the versions of .venv.
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

builds=
if [ "${1:-}" = --build ]; then
    builds=1
    shift
fi
# pip and its build tools write their byte-code, or each start would compile them again.
unset PYTHONDONTWRITEBYTECODE

# shellcheck source=scripts/ros_underlay.bash
. scripts/ros_underlay.bash
venv=$bev_preheat_place/.venv
python=$venv/bin/python
# As it is said: .venv or .environments/NAME/.venv.
venv_name=${venv#"$bev_preheat_root/"}
environment=${BEV_PREHEAT_ENVIRONMENT:-}
case $environment in kilted) ros_name=Kilted ;; *) ros_name=Jazzy ;; esac

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
    [ "$environment" != oldest ] || candidates="${pythons//3./python3.} python3"
    for candidate in ${PYTHON:-$candidates}; do
        if is_new_enough "$candidate"; then
            command -v "$candidate"
            return
        fi
    done
    fail "needs Python $oldest_python or newer; ${PYTHON:-python3} is $("${PYTHON:-python3}" --version 2>/dev/null || echo not there)" \
        "  install one (Debian, Ubuntu: python3.12 python3.12-venv python3.12-dev) or name it: make setup PYTHON=/path/to/python3.12"
}

# --- packages ---

# With process groups of their own (set -m), background jobs can be ended together with all that they started.
jobs_running=()
in_background() {
    set -m
    "$@" &
    jobs_running+=($!)
    set +m
}

end_background() {
    local job
    for job in ${jobs_running[@]+"${jobs_running[@]}"}; do
        if kill -INT -- "-$job" 2>/dev/null; then wait "$job" 2>/dev/null || true; fi
    done
    jobs_running=()
}
trap end_background EXIT

# uv reads no configuration of pip, so it may be there and not reach the index. It does not see the packages of a
# distribution.
find_uv() {
    [ -z "$bev_preheat_underlay" ] || return 1
    [ -n "${uv_works:-}" ] || {
        uv_works=no
        # The certificates of the system, as pip may be configured to use; older versions know the first name.
        export UV_NATIVE_TLS=1 UV_SYSTEM_CERTS=1
        if command -v uv >/dev/null && timeout 10 uv pip install --quiet --dry-run --no-deps --reinstall --refresh-package tzdata \
            --python "$python" tzdata >/dev/null 2>&1; then
            uv_works=yes
            say "using $(uv --version)"
        fi
    }
    [ "$uv_works" = yes ]
}

# pip without byte-code: compile_packages and the first imports make it, in parallel.
pip_install() {
    "$python" -m pip install --no-input --disable-pip-version-check --progress-bar off --no-compile "$@"
}

# Copies, because mend_cmake_files writes into files that would otherwise be those of uv's cache.
uv_install() {
    uv pip install --no-progress --link-mode copy --python "$python" "${@/--force-reinstall/--reinstall}"
}

# install_packages FILE [OPTION ...]. Packages without dependencies among pip's choices are installed by two processes
# at once: pip waits for the network half of the time.
install_packages() {
    local list=$1 part parts=("$1") pids=() log=$venv/install.log installer=pip failed=
    shift
    if find_uv; then
        installer=uv
    elif [[ " $* " == *' --no-deps '* ]]; then
        rm -f "$list".[01]
        awk -v list="$list" 'NF { print >(list "." NR % 2) }' "$list"
        parts=("$list".[01])
        # First by itself: neither process may replace setuptools while the other builds a package with it.
        if grep '^setuptools==' "$list" >"$list.setuptools"; then
            in_background pip_install "$@" -r "$list.setuptools" >"$list.setuptools.log" 2>&1
            # If it fails, the process whose part it is fails too, and is reported.
            wait "${jobs_running[-1]}" || true
        fi
    fi
    for part in "${parts[@]}"; do
        in_background "${installer}_install" "$@" -r "$part" >"$part.log" 2>&1
        pids+=("${jobs_running[-1]}")
    done
    for part in "${pids[@]}"; do wait "$part" || failed=$installer; done
    cat "${parts[@]/%/.log}" >"$log"
    [ -z "$failed" ] || {
        # A line of each package says nothing of the failure.
        grep -vE '^(Collecting|Requirement already|  (Using cached|Downloading)|WARNING: Location) ?' "$log" | tail -n 15 >&2
        fail "$failed could not install what is needed (all of its output: $log). Then run setup again." \
            "  The ROS wheels are for Linux on x86-64, glibc 2.28 or newer; elsewhere use a ROS 2 distribution."
    }
}

# With a virtual environment that sees the system's packages, the system's pip will do.
ensure_pip() {
    "$python" -m pip --version >/dev/null 2>&1 || "$python" -m ensurepip >/dev/null 2>&1 ||
        fail "there is no pip (Debian, Ubuntu: sudo apt install python3-venv)"
}

# Compile all installed packages but their tests, in parallel.
compile_packages() {
    nice "$python" -m compileall -q -j 0 -x '/tests?/|/cmake/data/' \
        "$("$python" -c 'import sysconfig; print(sysconfig.get_path("purelib"))')" >/dev/null 2>&1 || true
}

pins() { sed -nE '/^[^#]*==/{s/ *#.*//;p}' "$@"; }

# The packages of a group, one a line; "build" is requirements.txt. In the environment oldest all are in "build".
packages_of() {
    if [ "$environment" = oldest ]; then
        [ "$1" = build ] || return 0
        # But for the packages that the list of the oldest names.
        awk -F '==' 'FNR == NR { if (NF > 1) { named[$1] } ; next } NF > 1 && !($1 in named)' \
            scripts/requirements-oldest.txt scripts/requirements{,-demo,-test}.txt
        pins scripts/requirements-oldest.txt
        return
    fi
    case $1 in
        build)
            if [ -f "scripts/requirements-$environment.txt" ]; then
                pins scripts/requirements.txt | grep -v '^ros-'
                pins "scripts/requirements-$environment.txt"
            else
                pins scripts/requirements.txt
            fi
            ;;
        test) pins scripts/requirements-test.txt scripts/requirements-optional.txt ;;
        *)
            { grep -E "^[^#]+==.* #(.* )?$1( |\$)" scripts/requirements-optional.txt || true; } | pins
            [ ! -f "scripts/requirements-$1.txt" ] || pins "scripts/requirements-$1.txt"
            ;;
    esac | sort -u
}

group_names() {
    {
        sed -nE 's/^[^#]+==.* # ?//p' scripts/requirements-optional.txt | tr ' ' '\n' | grep -vx wheels
        printf '%s\n' scripts/requirements-*.txt | sed -E 's/.*requirements-(.*)\.txt/\1/' | grep -vxE 'kilted|oldest|optional'
    } | sed '/^$/d' | sort -u
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
    printf '%s\n' "$venv" "$(version_of "$1") ${bev_preheat_underlay:-wheels} $(packages_of build | cksum)"
}

group_stamp() { packages_of "$1" | cksum; }

# .ready-GROUP names a group that is installed, .adding-GROUP one whose installation has begun: pip takes a package for
# installed that is only half there.
groups_there() {
    local file
    for file in "$venv"/.ready-* "$venv"/.adding-*; do
        [ ! -e "$file" ] || printf '%s\n' "${file#"$venv"/.*-}"
    done
}

has_group() { [ ! -e "$venv/.adding-$1" ] && [ "$(cat "$venv/.ready-$1" 2>/dev/null)" = "$(group_stamp "$1")" ]; }

# Rebuilt rather than upgraded if a list has changed: its former packages must not remain.
groups_unchanged() {
    local group
    for group in $(groups_there); do
        [ ! -e "$venv/.ready-$group" ] || [ "$(cat "$venv/.ready-$group")" = "$(group_stamp "$group")" ] || return 1
    done
}

is_ready() {
    # Without PYTHON, keep the Python of .venv: a later "make" must not switch back to python3.
    [ -x "$python" ] && { [ -z "${PYTHON:-}" ] || [ "$(version_of "$PYTHON")" = "$(version_of "$python")" ]; } &&
        [ "$(cat "$venv/.ready" 2>/dev/null)" = "$(stamp_for "$python")" ] && groups_unchanged
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
    # As before, and the group without which the environment is not complete.
    groups=$(printf '%s\n' "$groups" "$(groups_there)" | sort -u)
    rm -f "$venv/.ready"
}

trap 'trap - INT TERM; echo; say "interrupted; the next make or scripts/setup.bash continues" >&2; exit 130' INT TERM

# What builds need is there; the group demo may still be missing.
finish_base() {
    write_local_setup
    local group
    for group in $groups; do : >"$venv/.adding-$group"; done
    stamp_for "$python" >"$venv/.ready.new"
    mv "$venv/.ready.new" "$venv/.ready"
    did=1
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
    say "ROS 2 $ros_name and what else is needed go into $venv_name, with Python $(version_of "$base")"
    make_venv "$base" --clear
    packages_of build >"$venv/requirements.txt"
    say "downloading and installing $(wc -l <"$venv/requirements.txt") packages for the build, half a minute or more"
    install_packages "$venv/requirements.txt" --no-deps
    mend_cmake_files
    finish_base
}

make_venv_of_distribution() {
    # The system's packages may have changed since.
    # shellcheck disable=SC2046
    if is_ready && [ -z "$("$python" scripts/lacking_packages.py $(groups_there))" ]; then
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
    finish_base
}

add_to_distribution() {
    "$python" scripts/lacking_packages.py "$@" >"$venv/requirements.txt"
    [ -s "$venv/requirements.txt" ] || return 0
    ensure_pip
    "$python" scripts/lacking_packages.py --constraints "$@" >"$venv/constraints.txt"
    install_packages "$venv/requirements.txt" -c "$venv/constraints.txt" ${again:+--force-reinstall}
}

add_groups() {
    local group wanted='' again=''
    for group in $groups; do
        has_group "$group" || wanted+=" $group"
        [ ! -e "$venv/.adding-$group" ] || [ -n "${did:-}" ] || again=1
    done
    [ -n "$wanted" ] || return 0
    if [ "$environment" != oldest ]; then
        say "adding the packages of:$wanted"
        for group in $wanted; do : >"$venv/.adding-$group"; done
        # shellcheck disable=SC2086
        if [ -n "$bev_preheat_underlay" ]; then
            add_to_distribution $wanted
        else
            for group in $wanted; do packages_of "$group"; done | sort -u >"$venv/requirements.txt"
            install_packages "$venv/requirements.txt" --no-deps ${again:+--force-reinstall}
        fi
    fi
    case " $wanted " in *' demo '*) compile_packages ;; esac
    for group in $wanted; do
        group_stamp "$group" >"$venv/.ready-$group"
        rm -f "$venv/.adding-$group"
    done
    did=1
}

# The build beside the installation: its output is shown when both are done.
start_build() {
    say "building the core and the messages meanwhile"
    in_background scripts/build.bash >"$venv/build.log" 2>&1
    build_job=${jobs_running[-1]}
}

finish_build() {
    local status=0
    wait "$build_job" || status=$?
    cat "$venv/build.log"
    [ "$status" = 0 ] || fail "the build has failed (its output, as above: $venv/build.log)"
}

for group in "$@"; do
    group_names | grep -qxF -e "$group" ||
        fail "unknown group $group; usage: scripts/setup.bash [--build] [GROUP ...]; groups: $(group_names | paste -s -d ' ')"
done
groups=$(printf '%s\n' demo "$@" | sort -u)

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
[ -z "$builds" ] || [ -z "${did:-}" ] || start_build
add_groups
[ -z "${build_job:-}" ] || finish_build
[ -z "${did:-}" ] || say "done in $SECONDS s"

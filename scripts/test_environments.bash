#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# usage: test_environments.bash NAME ... -- TEST ...
# Runs the tests in an environment and a build of its own for each name, in .environments/NAME. A name is a version of
# Python, looked for in PATH and in pyenv, or a ROS 2 distribution, whose wheels scripts/requirements-NAME.txt lists.
# Ends with a line for each name: passed, failed, or not tried and why.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

names=()
while [ "$1" != -- ]; do
    names+=("$1")
    shift
done
shift

# A shim of pyenv is found in PATH, but need not run.
find_python() {
    local candidate
    for candidate in "python$1" "${PYENV_ROOT:-$HOME/.pyenv}/versions/$1".*/bin/"python$1"; do
        if "$candidate" -I -S -c 'import sys; sys.exit("%d.%d" % sys.version_info[:2] != sys.argv[1])' "$1" 2>/dev/null; then
            command -v "$candidate"
            return
        fi
    done
    return 1
}

# Why the wheels of a distribution cannot be installed; nothing if they can.
lacking_wheels() {
    local folder answer
    [ ! -f "scripts/requirements-$1.txt" ] || return 0
    folder=$(mktemp -d)
    if answer=$(python3 -m pip download --quiet --disable-pip-version-check --no-deps --dest "$folder" "ros-$1-rclpy" 2>&1); then
        echo "the package index has ros-$1-rclpy, but scripts/requirements-$1.txt, the list of its packages, is missing"
    else
        grep '^ERROR' <<<"$answer" | tail -n 1
    fi
    rm -r "$folder"
}

# The versions that the tests ran with.
versions() {
    ".environments/$1/.venv/bin/python" - <<'PYTHON'
from importlib.metadata import version
import platform

print(f"Python {platform.python_version()}, rclpy {version('ros-rclpy')}, NumPy {version('numpy')}")
PYTHON
}

results=() tried='' failed=''
for name in "${names[@]}"; do
    # A distribution is tested with its own Python.
    case $name in
        kilted) version=3.12 ;;
        lyrical) version=3.14 ;;
        *) version=$name ;;
    esac
    why_not=
    [ "$version" = "$name" ] || why_not=$(lacking_wheels "$name")
    if [ -z "$why_not" ] && ! python=$(find_python "$version"); then
        why_not="Python $version is not installed"
    fi
    if [ -n "$why_not" ]; then
        results+=("$name: not tried: $why_not")
        continue
    fi
    echo "$name: tests with $python in .environments/$name"
    tried=1
    if BEV_PREHEAT_ENVIRONMENT=$name make --no-print-directory test PYTHON="$python" TESTS="$*"; then
        results+=("$name: passed with $(versions "$name"): $*")
    else
        results+=("$name: failed, of $*")
        failed=1
    fi
done
printf '%s\n' "${results[@]}"
[ -z "$failed" ] && [ -n "$tried" ]

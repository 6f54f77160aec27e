#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Runs the tests with each supported Python (scripts/pythons.txt) that is installed, in PATH or by pyenv. Each has an
# environment and a build of its own, in .pythons/VERSION. Arguments go to pytest.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

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

tried='' absent='' failed=''
while read -r version; do
    if python=$(find_python "$version"); then
        echo "test-pythons: Python $version: $python"
        BEV_PREHEAT_PYTHON=$version make --no-print-directory test PYTHON="$python" TESTS="${*:-test}" || failed+=" $version"
        tried+=" $version"
    else
        absent+=" $version"
    fi
done <scripts/pythons.txt
[ -z "$absent" ] || echo "test-pythons: not installed, so not tried:$absent"
[ -n "$tried" ] || { echo 'test-pythons: no supported Python is installed' >&2; exit 1; }
[ -z "$failed" ] || { echo "test-pythons: failed with Python$failed" >&2; exit 1; }
echo "test-pythons: passed with Python$tried"

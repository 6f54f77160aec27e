#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Compile the test files of a fresh checkout once, in two processes: each of pytest's workers imports every file, and
# they would all compile at the same time. Errors in a file are left for the tests to report.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

python=$(python3 -c 'import sys; print(sys.implementation.cache_tag)')
[ -z "$(find test/nodes -name "*.$python-pytest-*.pyc" -print -quit)" ] || exit 0
python3 -m pytest -q --collect-only test/nodes &>/dev/null &
python3 -m pytest -q --collect-only test --ignore=test/nodes &>/dev/null || true
wait "$!" || true

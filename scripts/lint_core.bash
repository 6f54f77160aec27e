#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Compile the core and the export's sources with each installed compiler, with warnings as errors; keep no output. Run in scripts/env.bash.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

generated=$(mktemp -d)
trap 'rm -rf "$generated"' EXIT
PYTHONPATH=$PWD:${PYTHONPATH:-} python3 -m bev_preheat.code_generation.c_source "$generated/bev_preheat_core_generated"
for compiler in gcc clang; do
    command -v "$compiler" >/dev/null || continue
    for source in core/src/*.c bev_preheat/code_generation/c/*.c; do
        "$compiler" -std=c99 -O2 -Wall -Wextra -Wpedantic -Wconversion -Werror -ffp-contract=off \
            -Icore/include -Icore/src -Ibev_preheat/code_generation/c -I"$generated" -c "$source" -o "$generated/object.o"
    done
done
if command -v cppcheck >/dev/null; then
    cppcheck --quiet --std=c99 --enable=warning,performance,portability --inline-suppr --error-exitcode=1 \
        -Icore/include -Icore/src -Ibev_preheat/code_generation/c -I"$generated" core/src bev_preheat/code_generation/c
fi

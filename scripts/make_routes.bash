#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Makes config/routes/*.csv again from the descriptions in config/routes/legs, driven by the
# reference vehicle; the same files come out each time.
set -euo pipefail

cd "$(dirname "${BASH_SOURCE[0]}")/.."
python=python3
if [ -x .venv/bin/python ]; then
    python=.venv/bin/python
fi
export PYTHONPATH="$PWD${PYTHONPATH:+:$PYTHONPATH}"

for description in config/routes/legs/*.yaml; do
    name=$(basename "$description" .yaml)
    "$python" -m bev_preheat route --legs "$name" --vehicle reference \
        --output "config/routes/$name.csv"
done

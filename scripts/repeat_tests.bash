#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Runs "make test" again and again, on an idle computer and beside one busy loop for each core: a test that depends
# on who gets the processor fails here. A line a run, the logs of failed runs in out/repeated_tests, exit status 1 if any failed.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

usage="usage: scripts/repeat_tests.bash [--idle N] [--busy N] [--target MAKE_TARGET]"
idle=10 busy=10 target=test
while [ $# -gt 0 ]; do
    case $1 in
        --idle | --busy)
            [[ ${2:-} =~ ^[0-9]+$ ]] || { echo "repeat_tests: error: $1: must be a number of runs; $usage" >&2; exit 2; }
            printf -v "${1#--}" %d "$((10#$2))"; shift 2 ;;
        --target)
            [[ ${2:-} =~ ^test[a-z-]*$ ]] || { echo "repeat_tests: error: --target: must be a target of the Makefile whose name begins with test; $usage" >&2; exit 2; }
            target=$2; shift 2 ;;
        --help | -h) echo "$usage"; exit 0 ;;
        *) echo "repeat_tests: error: $1: is no option; $usage" >&2; exit 2 ;;
    esac
done

folder=out/repeated_tests
mkdir -p "$folder"
loops=() run=""

end_loops() {
    for loop in ${loops[@]+"${loops[@]}"}; do
        # Waited for, or bash would tell that it was killed.
        { kill -KILL "$loop"; wait "$loop"; } 2>/dev/null || true
    done
    loops=()
}
# The run has a process group of its own: all that it started ends with it.
end_all() {
    end_loops
    [ -z "$run" ] || kill -TERM -- "-$run" 2>/dev/null || true
}
trap end_all EXIT
trap 'exit 130' INT
trap 'exit 143' TERM HUP

start_loops() {
    for ((core = 0; core < $(nproc); core++)); do
        # Ends by itself if this script is killed.
        (while kill -0 "$$" 2>/dev/null; do for ((i = 0; i < 1000000; i++)); do :; done; done) &
        loops+=($!)
    done
}

make build
failed=0
for load in idle busy; do
    for ((number = 1; number <= ${!load}; number++)); do
        log=$folder/${load}_$number.log
        [ "$load" = idle ] || start_loops
        began=$SECONDS status=0
        set -m
        make "$target" >"$log" 2>&1 </dev/null &
        run=$!
        set +m
        wait "$run" || status=$?
        run=""
        end_loops
        # pytest's last line, without the time, which stands in front; then the names of the failed tests.
        result=$(grep -E '[0-9]+ (passed|failed|error)' "$log" | tail -n 1 | sed -E 's/^=* *//; s/ in [0-9.]+s.*//') || result="no result"
        printf '%s %2d of %d: %4d s, %s\n' "$load" "$number" "${!load}" $((SECONDS - began)) "$result"
        if [ "$status" -eq 0 ]; then
            rm -f "$log"
        else
            failed=$((failed + 1))
            grep -E '^(FAILED|ERROR) ' "$log" | sed -E 's/^/    /; s/ - .*//' || true
            echo "    exit status $status, log: $log"
        fi
    done
done
echo "$((idle + busy)) runs, $failed failed"
[ "$failed" -eq 0 ]

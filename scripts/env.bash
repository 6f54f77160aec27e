# SPDX-License-Identifier: Apache-2.0
# shellcheck shell=bash
# To be sourced, from bash or zsh, in any folder:  . scripts/env.bash
# Enters a working shell: ROS 2 (the distribution, else from wheels), .venv, then what "make build" made.

if [ -n "${ZSH_VERSION:-}" ]; then
    # In zsh's own words, which other shells cannot even parse.
    eval 'bev_preheat_root=${${(%):-%x}:A:h:h}'
else
    bev_preheat_root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd -P)
fi
# shellcheck source=scripts/ros_underlay.bash
. "$bev_preheat_root/scripts/ros_underlay.bash"
bev_preheat_enter demo

case $(bev_preheat_venv_state demo) in
    unfinished) bev_preheat_problem="setup was interrupted or has failed, .venv is incomplete" ;;
    moved) bev_preheat_problem="this checkout was moved or copied after setup" ;;
    absent) bev_preheat_problem="not set up yet" ;;
    ready)
        bev_preheat_problem=
        if [ ! -r "$bev_preheat_place/install/setup.$bev_preheat_shell" ]; then
            bev_preheat_problem="ROS 2 is ready, the project is not built"
        fi
        ;;
esac
if [ -n "$bev_preheat_problem" ]; then
    echo "bev_preheat: $bev_preheat_problem; run: make -C $bev_preheat_root build" >&2
else
    bev_preheat_source "$bev_preheat_place/install/setup.$bev_preheat_shell"
    # The distribution's own setup may have put the system's Python first.
    if [ "$(command -v python3)" != "$bev_preheat_place/.venv/bin/python3" ]; then
        export PATH="$bev_preheat_place/.venv/bin:$PATH"
    fi
    case ":$PATH:" in
        *":$bev_preheat_place/install/bev_preheat/lib/bev_preheat:"*) ;;
        *) export PATH="$bev_preheat_place/install/bev_preheat/lib/bev_preheat:$PATH" ;;
    esac
fi
# Ubuntu has python3 only; the documentation says python.
if ! command -v python >/dev/null; then
    python() { python3 "$@"; }
fi

unset bev_preheat_root bev_preheat_place bev_preheat_underlay bev_preheat_shell bev_preheat_problem
unset -f bev_preheat_sourced_distribution bev_preheat_source bev_preheat_enter_distribution bev_preheat_venv_state bev_preheat_enter

# SPDX-License-Identifier: Apache-2.0
# shellcheck shell=bash
# To be sourced, from bash or zsh, in any folder:  . scripts/env.bash
# Enters a working shell: ROS 2 (the distribution, else .venv), then what "make build" made.

if [ -n "${ZSH_VERSION:-}" ]; then
    # In zsh's own words, which other shells cannot even parse.
    eval 'bev_preheat_root=${${(%):-%x}:A:h:h}'
else
    bev_preheat_root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd -P)
fi
# shellcheck source=scripts/ros_underlay.bash
. "$bev_preheat_root/scripts/ros_underlay.bash"
bev_preheat_enter

if [ -z "$bev_preheat_underlay" ]; then
    echo "bev_preheat: no ROS 2 here yet; run: make -C $bev_preheat_root build" >&2
elif [ ! -r "$bev_preheat_root/install/setup.$bev_preheat_shell" ]; then
    echo "bev_preheat: ROS 2 is ready, the project is not built; run: make -C $bev_preheat_root build" >&2
else
    bev_preheat_source "$bev_preheat_root/install/setup.$bev_preheat_shell"
    case ":$PATH:" in
        *":$bev_preheat_root/install/bev_preheat/lib/bev_preheat:"*) ;;
        *) export PATH="$bev_preheat_root/install/bev_preheat/lib/bev_preheat:$PATH" ;;
    esac
fi
# Ubuntu has python3 only; the documentation says python.
if ! command -v python >/dev/null; then
    python() { python3 "$@"; }
fi

unset bev_preheat_root bev_preheat_underlay bev_preheat_shell
unset -f bev_preheat_sourced_distribution bev_preheat_source bev_preheat_enter_distribution bev_preheat_enter

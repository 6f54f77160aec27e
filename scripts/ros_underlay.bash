# SPDX-License-Identifier: Apache-2.0
# shellcheck shell=bash
# For the other scripts, from bash or zsh: enters what lies under this project, a ROS 2 distribution and .venv.
# Needs bev_preheat_root; answers in bev_preheat_underlay (the distribution's prefix, ".venv" or empty).

: "${bev_preheat_root:?is set by the script that reads this file}"
# Here .venv, build, install and log are. An environment with other versions (make test-oldest, test-pythons,
# test-distributions) has its own, with ROS from wheels, whatever the machine has.
bev_preheat_place=$bev_preheat_root${BEV_PREHEAT_ENVIRONMENT:+/.environments/$BEV_PREHEAT_ENVIRONMENT}
bev_preheat_shell=bash
if [ -n "${ZSH_VERSION:-}" ]; then bev_preheat_shell=zsh; fi

# A prefix that holds rclpy is a distribution, unless it is a virtual environment: then it is ours or
# another checkout's. ROS_DISTRO alone proves nothing, container images set it before anything is sourced.
bev_preheat_sourced_distribution() {
    printf '%s\n' "${AMENT_PREFIX_PATH:-}" | tr ':' '\n' | while IFS= read -r prefix; do
        if [ -n "$prefix" ] && [ -d "$prefix/share/rclpy" ] && [ ! -e "$prefix/pyvenv.cfg" ]; then
            printf '%s\n' "$prefix"
            break
        fi
    done
}

# Files of ROS and colcon read variables that may be unset and run commands that may fail, so the caller's
# -e and -u are lifted meanwhile, and put back.
bev_preheat_source() {
    case $- in *e*) local had_e=1 ;; *) local had_e= ;; esac
    case $- in *u*) local had_u=1 ;; *) local had_u= ;; esac
    set +eu
    # shellcheck disable=SC1090
    . "$1"
    if [ -n "$had_u" ]; then set -u; fi
    if [ -n "$had_e" ]; then set -e; fi
}

bev_preheat_enter_distribution() {
    bev_preheat_underlay=
    if [ -n "${BEV_PREHEAT_ENVIRONMENT:-}" ]; then
        unset AMENT_PREFIX_PATH CMAKE_PREFIX_PATH COLCON_PREFIX_PATH LD_LIBRARY_PATH PYTHONPATH ROS_DISTRO
        return
    fi
    bev_preheat_underlay=$(bev_preheat_sourced_distribution)
    local setup=/opt/ros/${ROS_DISTRO:-jazzy}/setup.$bev_preheat_shell
    if [ -z "$bev_preheat_underlay" ] && [ -r "$setup" ]; then
        bev_preheat_source "$setup"
        bev_preheat_underlay=${setup%/*}
    fi
}

# "ready", "absent", "unfinished" (setup was interrupted or has failed) or "moved". The place counts, because a
# virtual environment does not survive being moved or copied. The argument is the group that must be
# there, demo (all that the program always needs) without one; builds need none.
bev_preheat_venv_state() {
    local venv=$bev_preheat_place/.venv
    if [ ! -e "$venv" ]; then
        echo absent
    elif [ ! -r "$venv/.ready" ] || [ -e "$venv/.adding-${1:-demo}" ]; then
        echo unfinished
    elif ! grep -qxF "$venv" "$venv/.ready"; then
        echo moved
    else
        echo ready
    fi
}

bev_preheat_enter() {
    bev_preheat_enter_distribution
    if [ "$(bev_preheat_venv_state "$@")" = ready ]; then
        bev_preheat_source "$bev_preheat_place/.venv/local_setup.$bev_preheat_shell"
        : "${bev_preheat_underlay:=.venv}"
        # The wheels' start-up hook trusts this mark, which another checkout's Python may have left in our environment.
        unset _ROS_WHEELS_BOOTSTRAP_COMPLETE
    fi
}

# SPDX-License-Identifier: Apache-2.0
# shellcheck shell=bash
# Completion of `preheat` for bash; install/setup.bash reads it. It needs argcomplete.
if command -v register-python-argcomplete >/dev/null 2>&1; then
    eval "$(register-python-argcomplete preheat)"
elif command -v register-python-argcomplete3 >/dev/null 2>&1; then
    eval "$(register-python-argcomplete3 preheat)"
fi

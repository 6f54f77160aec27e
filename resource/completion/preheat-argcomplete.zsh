# SPDX-License-Identifier: Apache-2.0
# Completion of `preheat` for zsh; install/setup.zsh reads it.
if (( ! ${+_comps} )); then
    autoload -U +X compinit && compinit
fi
autoload -U +X bashcompinit && bashcompinit
. "${0:a:h}/preheat-argcomplete.bash"

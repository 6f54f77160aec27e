# SPDX-License-Identifier: Apache-2.0
"""`python -m bev_preheat` is `preheat`."""

import sys

from bev_preheat.commands.main import main

sys.exit(main())

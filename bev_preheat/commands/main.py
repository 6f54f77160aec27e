# SPDX-License-Identifier: Apache-2.0
"""`preheat`: the offline command line. Each subcommand is a module of this folder."""

import argparse
from importlib import import_module
import sys

from bev_preheat.errors import InvalidInput, PlanningFailure

# Modules with add_parser(subparsers), which sets `run`, a function of the parsed arguments that
# returns the exit status.
SUBCOMMANDS = ('plan', 'optimum', 'compare', 'reproduce', 'sweep', 'robustness', 'scenario', 'route',
               'monitor')


def main(arguments=None):
    """Run one subcommand and return its exit status: 0, or 2 where input was refused."""
    parser = argparse.ArgumentParser(
        prog='preheat',
        description='When to warm the battery of an electric vehicle before fast charging.')
    subparsers = parser.add_subparsers(required=True, metavar='COMMAND')
    for name in SUBCOMMANDS:
        import_module(f'bev_preheat.commands.{name}').add_parser(subparsers)
    parsed = parser.parse_args(arguments)
    try:
        return parsed.run(parsed)
    except InvalidInput as error:
        for problem in error.problems:
            print(f'preheat: error: {problem}', file=sys.stderr)
        return 2
    except PlanningFailure as error:
        print(f'preheat: error: {error}', file=sys.stderr)
        return 2
    except BrokenPipeError:
        # The reader of the output has gone, as in `preheat plan … | head`.
        sys.stderr.close()
        return 0


if __name__ == '__main__':
    sys.exit(main())

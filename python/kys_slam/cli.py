# SPDX-License-Identifier: BSD-3-Clause
"""The command kys-slam: track any stereo recording, evaluate and draw what came of it."""

import io
import os
import sys
from typing import Callable, List, Optional

from kys_slam.cli_errors import describe, interrupted
from kys_slam.cli_parser import make_parser


def _function_of(command: str) -> Callable:
    """Takes the parsed options, returns an exit status. Imports what the command needs."""
    if command == "run":
        from kys_slam.cli_run import run
        return run
    if command == "check":
        from kys_slam.cli_check import check
        return check
    if command == "features":
        from kys_slam.cli_features import features_command
        return features_command
    if command == "map":
        from kys_slam.cli_map import map_command
        return map_command
    from kys_slam.cli_commands import COMMANDS
    return COMMANDS[command]


def main(argv: Optional[List[str]] = None) -> int:
    """The program. Returns the exit status: 0, 2 for bad usage or input, 3 when tracking failed
    or a check cannot tell, 70 for a defect of the program, 130 when interrupted before tracking."""
    for stream in (sys.stdout, sys.stderr):  # names of files may be no text
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")
    args = make_parser().parse_args(argv)
    try:
        status = _function_of(args.command)(args)
        sys.stdout.flush()  # here, where a reader that has gone is no error
        return status
    except KeyboardInterrupt:  # before anything is tracked; later the run ends in order
        return interrupted()
    except BrokenPipeError:  # the reader of the output has seen enough, e.g. head
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except Exception as error:
        status, message = describe(error)
        print(f"kys-slam: {message}", file=sys.stderr)
        return status


if __name__ == "__main__":
    sys.exit(main())

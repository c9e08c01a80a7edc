"""The program's entry point, which loads little before signals are handled without a traceback."""

from __future__ import annotations

import os
import signal

# Until there is somebody to say more, the interrupt key just ends the program. An ignored one stays ignored.
if hasattr(os, "fork") and signal.getsignal(signal.SIGINT) is signal.default_int_handler:
    signal.signal(signal.SIGINT, signal.SIG_DFL)

from gesturegen import supervision


def start() -> None:
    """Run the command line in a supervised child process."""

    def run() -> None:
        from gesturegen.cli import main

        main.main(prog_name="gesturegen")

    supervision.supervise(run)


if __name__ == "__main__":
    start()

"""The program's entry point: it loads little before it can be stopped without a traceback."""

from __future__ import annotations

from gesturegen import supervision


def start() -> None:
    """Run the command line under supervision."""

    def run() -> None:
        from gesturegen.cli import main

        main.main(prog_name="gesturegen")

    supervision.supervise(run)


if __name__ == "__main__":
    start()

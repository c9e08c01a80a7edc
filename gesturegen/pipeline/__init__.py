"""One function per subcommand: files in, files out. The only home of work over many clips.

Each returns what the command line shows; errors of single clips are in its `Outcome`, so that the other
clips are unharmed. An error that concerns the whole command is raised.
"""

from gesturegen.pipeline.build_graph import build_graphs
from gesturegen.pipeline.common import Summary
from gesturegen.pipeline.datasets import demo_data, init
from gesturegen.pipeline.evaluate import evaluate
from gesturegen.pipeline.preprocess import preprocess, suggest_blacklist
from gesturegen.pipeline.reenact import reenact
from gesturegen.pipeline.run import run
from gesturegen.pipeline.submit import check, pack

__all__ = [
    "Summary",
    "build_graphs",
    "check",
    "demo_data",
    "evaluate",
    "init",
    "pack",
    "preprocess",
    "reenact",
    "run",
    "suggest_blacklist",
]

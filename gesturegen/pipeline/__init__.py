"""The subcommands, one function each: they read files, write files, and alone work on many clips at once.

Each returns what the command line shows; errors of single clips are in its `Outcome`, so that the other
clips are unharmed. An error that concerns the whole command is raised.
"""

from gesturegen.pipeline.align import align, transcribe
from gesturegen.pipeline.build_graph import build_graphs
from gesturegen.pipeline.common import Summary
from gesturegen.pipeline.datasets import demo_data, init
from gesturegen.pipeline.doctor import doctor
from gesturegen.pipeline.evaluate import evaluate
from gesturegen.pipeline.experiment import ablate, compare
from gesturegen.pipeline.export import export
from gesturegen.pipeline.inspect import inspect
from gesturegen.pipeline.preprocess import preprocess
from gesturegen.pipeline.reenact import reenact
from gesturegen.pipeline.refiner import train_refiner
from gesturegen.pipeline.report import report
from gesturegen.pipeline.run import run
from gesturegen.pipeline.submit import check, pack
from gesturegen.pipeline.video import render_videos

__all__ = [
    "Summary",
    "ablate",
    "align",
    "build_graphs",
    "check",
    "compare",
    "demo_data",
    "doctor",
    "evaluate",
    "export",
    "init",
    "inspect",
    "pack",
    "preprocess",
    "reenact",
    "render_videos",
    "report",
    "run",
    "train_refiner",
    "transcribe",
]

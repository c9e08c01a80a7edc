"""The methods, which choose reference frames for speech: one folder each, all of them in the table `METHODS`."""

from gesturegen.methods.baseline.method import Baseline
from gesturegen.methods.gesture_master.method import GestureMasterMethod
from gesturegen.methods.method import Method, Trainer
from gesturegen.methods.motion_graph.method import MotionGraphMethod
from gesturegen.methods.motion_matching.method import MotionMatchingMethod

# The method on whose motion the refinement network is trained.
TRAINER: Trainer = MotionMatchingMethod()
METHODS: dict[str, Method] = {
    method.name: method for method in (MotionGraphMethod(), GestureMasterMethod(), TRAINER, Baseline())
}

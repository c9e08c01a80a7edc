"""Methods choose frames: a module with `build(references, config)` and `search(library, speech, config, rng, earlier)`."""

from gesturegen.methods import motion_graph

METHODS = {"motion_graph": motion_graph}

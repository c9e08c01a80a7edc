"""The embedded demo dataset: synthetic speakers whose gestures fall on their stressed syllables."""

from gesturegen.demo.dataset import CHALLENGE_SECONDS, ClipSpec, clip_specs, write_clip, write_metadata

__all__ = ["CHALLENGE_SECONDS", "ClipSpec", "clip_specs", "write_clip", "write_metadata"]

"""A GENEA-like skeleton: the challenge's 83 joints, names, hierarchy and channels, with round offsets of our making."""

from __future__ import annotations

from functools import cache

import numpy as np

from gesturegen.motion import bvh
from gesturegen.motion.skeleton import Skeleton

CHANNELS = ("Xposition", "Yposition", "Zposition", "Zrotation", "Xrotation", "Yrotation")

# One joint per line, indented by its depth: name and OFFSET in cm; `end` is an End Site. The rest pose is
# a T-pose: Y up, facing +Z, the speaker's right at -X.
_TREE = """
body_world 0 0 0
 b_root 0 91.5 0
  b_spine0 0 3 -3
   b_spine1 0 11 2
    b_spine2 0 11 -4
     b_spine3 0 18 -2
      b_neck0 0 12.5 3
       b_head 0 6.5 3
        b_head_null 0 20 4
         end 0 0 0
        b_l_eye 3.2 7 8.5
         end 0 -0.2 1.7
        b_r_eye -3.2 7 8.5
         end 0 -0.2 1.7
        b_jaw 0 5 2
         b_jaw_null 0 -9 6
          end 0 0 0
         b_teeth 0 -6 3
          end 0 0 0
         b_tongue0 0 -6 3
          b_tongue1 0 -0.1 -1.7
           b_tongue2 0 0.8 2.5
            b_tongue3 0 -0.5 2.25
             b_tongue4 0 -0.2 0.5
              b_l_tongue4_1 0.2 -0.1 0
               end 0.2 -0.1 0
              b_r_tongue4_1 -0.2 -0.1 0
               end -0.2 -0.1 0
             b_l_tongue3_1 0.2 -0.1 0
              end 0.4 -0.1 0
             b_r_tongue3_1 -0.2 -0.1 0
              end -0.4 -0.1 0
            b_l_tongue2_1 0.2 -0.1 0
             end 0.6 -0.1 0
            b_r_tongue2_1 -0.2 -0.1 0
             end -0.6 -0.1 0
           b_r_tongue1_1 -0.2 -0.1 0
            end -0.8 -0.1 0
           b_l_tongue1_1 0.2 -0.1 0
            end 0.8 -0.1 0
      b_r_shoulder -3 7 9
       p_r_scap -16 -1 -5
        b_r_arm 0 -4 -0.5
         b_r_arm_twist 0 0 0
          b_r_forearm -26 0 0
           b_r_wrist_twist -24.5 0 0
            b_r_wrist -2 -0.2 1.5
             b_r_index1 -9 -0.5 2.25
              b_r_index2 -4.5 0 0
               b_r_index3 -2.5 0 0
                end -1.3 0 0
             b_r_ring1 -8 -0.3 -2
              b_r_ring2 -4.5 0 0
               b_r_ring3 -3 0 0
                end -1.3 0 0
             b_r_middle1 -8.75 0 0
              b_r_middle2 -5 0 0
               b_r_middle3 -3 0 0
                end -1.4 0 0
             b_r_pinky1 -7 -1.1 -4
              b_r_pinky2 -3.5 0 0
               b_r_pinky3 -2 0 0
                end -1.3 0 0
             b_r_thumb0 -1 -0.4 0.8
              b_r_thumb1 -1 -2.25 1.7
               b_r_thumb2 -4.25 -0.7 1.5
                b_r_thumb3 -3.75 -0.1 0.2
                 end -1.9 0 0.1
      b_l_shoulder 3 7 9
       p_l_delt 15 0 -4
        end 0 0 0
       p_l_scap 16 -1 -5
        b_l_arm 0 -4 -0.5
         b_l_arm_twist 0 0 0
          b_l_forearm 26 0 0
           b_l_wrist_twist 24.5 0 0
            b_l_wrist 2 -0.2 1.5
             b_l_thumb0 1 -0.4 0.8
              b_l_thumb1 1 -2.25 1.7
               b_l_thumb2 4.25 -0.7 1.5
                b_l_thumb3 3.75 -0.1 0.2
                 end 1.9 0 0.1
             b_l_index1 9 -0.5 2.25
              b_l_index2 4.5 0 0
               b_l_index3 2.5 0 0
                end 1.3 0 0
             b_l_middle1 8.75 0 0
              b_l_middle2 5 0 0
               b_l_middle3 3 0 0
                end 1.4 0 0
             b_l_ring1 8 -0.3 -2
              b_l_ring2 4.5 0 0
               b_l_ring3 3 0 0
                end 1.3 0 0
             b_l_pinky1 7 -1.1 -4
              b_l_pinky2 3.5 0 0
               b_l_pinky3 2 0 0
                end 1.3 0 0
     p_navel 0 -12 2
      end 0 0 0
  b_r_upleg -9 -7 -1.5
   b_r_leg 0 -37.5 0
    b_r_foot_twist 0 -40 -3
     b_r_foot 0 0 0
      end 0 -6.5 16.5
  b_l_upleg 9 -7 -1.5
   b_l_leg 0 -37.5 0
    b_l_foot_twist 0 -40 -3
     b_l_foot 0 0 0
      end 0 -6.5 16.5
"""


@cache
def skeleton() -> Skeleton:
    """Build the demo skeleton: 83 joints of six channels each, 27 End Sites."""
    names: list[str] = []
    parents: list[int] = []
    offsets: list[list[float]] = []
    end_sites: list[list[float]] = []
    above: list[int] = []  # the joints from the root down to the current line
    for line in _TREE.strip().splitlines():
        name, *numbers = line.split()
        above = above[: len(line) - len(line.lstrip())]
        vector = [float(number) for number in numbers]
        if name == "end":
            end_sites[above[-1]] = vector
            continue
        parents.append(above[-1] if above else -1)
        above = [*above, len(names)]
        names.append(name)
        offsets.append(vector)
        end_sites.append([np.nan] * 3)
    channels = [CHANNELS] * len(names)
    offset_array, end_array = np.array(offsets), np.array(end_sites)
    text = bvh.hierarchy_text(names, parents, offset_array, end_array, channels)
    return Skeleton(tuple(names), np.array(parents), offset_array, end_array, tuple(channels), text)

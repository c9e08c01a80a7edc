"""Check that the recommended setting keeps its promises beside the published one, on every clip of two runs.

    python scripts/check_best.py WORK_OF_BEAM WORK_OF_BEST

Both work folders have been evaluated. Prints one line per promise and clip, or all of them together; exit code 1 when one is broken.
"""

from __future__ import annotations

import sys
from pathlib import Path

from gesturegen import files

# What is asked: name, what it is computed from (beam's row, best's row), and the bound. Of each clip:
PROMISES = (
    ("join distance, times lower", lambda beam, best: beam["join_distance_sum"] / best["join_distance_sum"], ">=", 4.0),
    ("hard joins a minute", lambda _, best: best["hard_joins_per_minute"], "<=", 12.0),
    ("mean stay, s", lambda _, best: best["stay_seconds"], ">=", 4.0),
    ("stutters a minute", lambda _, best: best["stutters_per_minute"], "<=", 0.5),
    ("shown again", lambda _, best: best["again_share"], "<=", 0.02),
    ("reference used", lambda _, best: best["reference_share"], ">=", 0.6),
    ("both hands still", lambda _, best: best["still_share"], "<=", 0.009),
    ("hands still, longest s", lambda _, best: best["still_longest"], "<=", 0.5),
    ("knees beyond 177 degrees", lambda _, best: best["knees_straight"], "<=", 0.0),
    ("wrist speed / source", lambda _, best: best["wrist_speed_ratio"], ">=", 0.9),
    ("wrist speed / source", lambda _, best: best["wrist_speed_ratio"], "<=", 1.1),
    ("foot skate / reference's", lambda _, best: best["foot_skate_ratio"], "<=", 1.3),
)
# Of all clips together: what a clip of a minute has too few joins, onsets or pauses to tell.
TOTALS = (
    ("a2m over chance, z", lambda _, best: best["a2m_z"], ">=", 1.7),
    ("minima of hands' speed over chance, z", lambda _, best: best["hands_beat_z"], ">=", 2.0),
    ("velocity, Fréchet / stretch's", lambda _, best: best["frechet_velocity_recording_ratio"], "<=", 1.3),
    ("joins found, AUC", lambda _, best: best["seam_auc"], "<=", 0.75),
    ("knee snaps a minute", lambda _, best: best["knee_snaps"], "<=", 0.5),
    ("pause frames from pauses", lambda _, best: best["pause_share"], ">=", 0.8),
    ("seam jerk", lambda _, best: best["seam_jerk"], "<=", 1.3),
    ("seam jerk on wrists", lambda _, best: best["seam_jerk_wrists"], "<=", 1.4),
)


def broken(name: str, promises: tuple, beam: dict, best: dict) -> int:
    """Print how each promise is kept; return how many are not."""
    found = 0
    for what, figure, sign, bound in promises:
        value = figure(beam, best)
        kept = value >= bound if sign == ">=" else value <= bound
        found += not kept
        print(f"{'kept  ' if kept else 'BROKEN'} {name}: {what}: {value:.3f} {sign} {bound:g}")
    return found


def main(beam_work: str, best_work: str) -> int:
    beam, best = (files.read_json(Path(work, "evaluate", "summary.json")) for work in (beam_work, best_work))
    if not best["clips"] or beam["clips"].keys() != best["clips"].keys():
        print(f"{best_work}: clips {sorted(best['clips'])}, {beam_work} has {sorted(beam['clips'])}; evaluate the same")
        return 1
    count = sum(broken(name, PROMISES, beam["clips"][name], row) for name, row in sorted(best["clips"].items()))
    count += broken("all", TOTALS, beam["total"], best["total"])
    print(f"{count} broken promises")
    return int(count > 0)


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))

"""Does the recommended setting keep what it promises beside the published one, on every clip of two runs?

    python scripts/check_best.py WORK_OF_BEAM WORK_OF_BEST

Both work folders have been evaluated. Prints one line per clip and promise; exit code 1 when one is broken.
"""

from __future__ import annotations

import sys
from pathlib import Path

from gesturegen import files

# What is asked of each clip: name, what it is computed from (beam's row, best's row), and the bound.
PROMISES = (
    ("join distance, times lower", lambda beam, best: beam["join_distance_sum"] / best["join_distance_sum"], ">=", 4.0),
    ("hard joins a minute", lambda beam, best: best["hard_joins_per_minute"], "<=", 12.0),
    ("mean stay, s", lambda beam, best: best["stay_seconds"], ">=", 4.0),
    ("stutters a minute", lambda beam, best: best["stutters_per_minute"], "<=", 0.5),
    ("shown again, beside beam's", lambda beam, best: best["again_share"] / beam["again_share"], "<=", 0.25),
    ("both hands still", lambda beam, best: best["still_share"], "<=", 0.009),
    ("knees beyond 177 degrees", lambda beam, best: best["knees_straight"], "<=", 0.0),
    ("a2m over chance, z", lambda beam, best: best["a2m_z"], ">=", 1.0),
    ("minima of hands' speed over chance, z", lambda beam, best: best["hands_beat_z"], ">=", 1.0),
    ("seam jerk", lambda beam, best: best["seam_jerk"], "<=", 1.3),
    ("seam jerk on wrists", lambda beam, best: best["seam_jerk_wrists"], "<=", 1.3),
    ("wrist speed / source", lambda beam, best: best["wrist_speed_ratio"], ">=", 0.9),
    ("wrist speed / source", lambda beam, best: best["wrist_speed_ratio"], "<=", 1.1),
    ("foot skate / reference's", lambda beam, best: best["foot_skate_ratio"], "<=", 1.3),
)


def main(beam_work: str, best_work: str) -> int:
    beam, best = (files.read_json(Path(work, "evaluate", "summary.json"))["clips"] for work in (beam_work, best_work))
    if not best or beam.keys() != best.keys():
        print(f"{best_work}: clips {sorted(best)}, {beam_work} has {sorted(beam)}; evaluate the same clips in both")
        return 1
    broken = 0
    for name in sorted(best):
        for what, figure, sign, bound in PROMISES:
            value = figure(beam[name], best[name])
            kept = value >= bound if sign == ">=" else value <= bound
            broken += not kept
            print(f"{'kept  ' if kept else 'BROKEN'} {name}: {what}: {value:.3f} {sign} {bound:g}")
    print(f"{broken} broken promises")
    return int(broken > 0)


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))

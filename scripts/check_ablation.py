"""Check the ablation on a small fixed dataset: against the checked-in table, and against what the mechanism guarantees.

    python scripts/check_ablation.py [--regenerate]

Makes two references and two tests of about a minute, runs `preprocess` and `ablate` for two seeds, and compares
with `tests/golden/ablation.json`. Prints one line per problem; exits with 1 when there is one.

Counts and names must be equal. Figures may differ by 1e-5 of their size: what they are computed from is rounded
(16-bit audio, BVH with six decimals), and the same frames are chosen wherever the counts agree, so that another
machine changes only the last digits of sums, some of them of float32 numbers (6e-8 each).

How long a search took is no figure of the table here: no second run repeats it.

`--regenerate` writes the table anew, loudly. Do so only when the behaviour is meant to change; then read the diff.
"""

from __future__ import annotations

import json
import math
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

from click.testing import CliRunner

from gesturegen import demo, strict_yaml
from gesturegen.cli import main as gesturegen
from gesturegen.experiment.presets import MACHINE
from gesturegen.settings.loading import configs_folder

GOLDEN = Path(__file__).parent.parent / "tests" / "golden" / "ablation.json"
TOLERANCE = 1e-5
# A new release, or a new setting whose default changes nothing, is no change of the table.
_CHANGING = {"version", "config_hashes"}
SEEDS = (0, 1)
SETUPS = ("weak_detection", "weak_pruning", "weak_initialization", "no_termination_fallback", "full")


def run(folder: Path) -> dict:
    """The table of the small fixed dataset."""
    data, work = folder / "data", folder / "work"
    specs = demo.clip_specs(references=2, tests=2, seed=2023, reference_seconds=(60.0, 64.0), test_seconds=(60.0, 62.0))
    for spec in specs:
        demo.write_clip(data, spec)
    demo.write_metadata(data, specs)
    plan = folder / "ablation.yaml"
    shipped = strict_yaml.read(configs_folder() / "ablation.yaml")
    plan.write_text(json.dumps({**shipped, "seeds": list(SEEDS)}))
    options = ["--data", str(data), "--work", str(work), "--set", "data.truth_split=truth"]
    for command in (["preprocess", "--config", "casia_go_2023"], ["ablate", "--config", str(plan)]):
        result = CliRunner().invoke(gesturegen, [*command, *options], catch_exceptions=False)
        if result.exit_code:
            sys.exit(result.output)
    print(result.output)
    return reproducible(json.loads((work / "ablation" / "ablation.json").read_text()))


def reproducible(table):
    """The table without what no second run repeats, wherever it stands."""
    if isinstance(table, dict):
        return {key: reproducible(value) for key, value in table.items() if key not in MACHINE}
    return [reproducible(value) for value in table] if isinstance(table, list) else table


def differences(found, expected, place: str = "") -> Iterator[str]:
    """One line for each value that is not as expected."""
    if isinstance(found, dict) and isinstance(expected, dict):
        for key in sorted(found.keys() | expected.keys()):
            if key not in found or key not in expected:
                yield f"{place}.{key}: {'missing' if key not in found else 'not in the checked-in table'}"
            elif key not in _CHANGING:
                yield from differences(found[key], expected[key], f"{place}.{key}" if place else key)
    elif isinstance(found, list) and isinstance(expected, list) and len(found) == len(expected):
        for number, pair in enumerate(zip(found, expected, strict=True)):
            yield from differences(*pair, f"{place}[{number}]")
    elif isinstance(found, float) and isinstance(expected, float):
        if not math.isclose(found, expected, rel_tol=TOLERANCE, abs_tol=1e-9):
            yield f"{place}: {found!r}, the checked-in table has {expected!r}"
    elif found != expected:
        yield f"{place}: {found!r}, the checked-in table has {expected!r}"


def broken_guarantees(table: dict) -> Iterator[str]:
    """What must hold on any data, whatever the figures are."""
    rows = {(row["setup"], row["seed"], row["clip"]): row for row in table["clips"]}
    lacking = 0
    for (setup, seed, clip), full in rows.items():
        if setup != "full":
            continue
        where = f"seed {seed}, {clip}"
        stuck, pruned, heard = (
            rows[name, seed, clip] for name in ("no_termination_fallback", "weak_pruning", "weak_detection")
        )
        if full["failure"]:
            yield f"{where}: full fails, which its fallbacks exclude"
        if full["lacking_keywords"]:
            lacking += 1
            if not stuck["failure"]:
                yield f"{where}: no_termination_fallback ends at {full['lacking_keywords']}, which the reference lacks"
        if not pruned["unnatural_edges"] > full["unnatural_edges"]:
            yield f"{where}: weak_pruning has {pruned['unnatural_edges']} edges, full {full['unnatural_edges']}"
        if not heard["pieces"] > full["pieces"]:
            yield f"{where}: weak_detection has {heard['pieces']} pieces, full {full['pieces']}"
        if len({tuple(rows[name, seed, clip]["references"]) for name in SETUPS}) > 1:
            yield f"{where}: the setups do not share their references"
    if not lacking:
        yield "no reference lacks a keyword of its test clip, so that nothing tests the fallback; change the dataset"


def main() -> None:
    with tempfile.TemporaryDirectory() as folder:
        table = run(Path(folder))
    del table["checksum"]  # of a file that holds how long searches took
    found = list(broken_guarantees(table))
    if "--regenerate" in sys.argv:
        GOLDEN.write_text(json.dumps(table, indent=1, ensure_ascii=False) + "\n")
        print(f"WRITTEN ANEW: {GOLDEN}\nWhatever it said before is no longer tested. Read its diff.")
    elif not GOLDEN.is_file():
        found.append(f"{GOLDEN}: missing; write it with --regenerate")
    else:
        found += differences(table, json.loads(GOLDEN.read_text()))
    for line in found:
        print(f"problem: {line}")
    print(f"ablation: {len(found)} problems")
    sys.exit(1 if found else 0)


if __name__ == "__main__":
    main()

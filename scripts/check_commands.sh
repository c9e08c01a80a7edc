#!/usr/bin/env bash
# The four commands on a dataset, with one worker up to JOBS: whole outputs each time, and always the same bytes.
#
#     scripts/check_commands.sh DATA TEST_SPLIT WORK JOBS [OPTION...]
#
# Writes WORK1, WORK2 and so on; the options are those of the commands.
set -euo pipefail
data="$1" split="$2" work="$3" most="$4"
shift 4
for jobs in $(seq "$most"); do
    for command in preprocess build-graph reenact evaluate; do
        .venv/bin/gesturegen "$command" "$@" --data "$data" --work "$work$jobs" --set "data.test_split=$split" -j "$jobs"
    done
    .venv/bin/python scripts/check_run.py "$work$jobs" "$data/$split" "$data/trn"
    [ "$jobs" = 1 ] || diff -r "${work}1" "$work$jobs"
done

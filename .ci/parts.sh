# Parts of a check: each is run, timed and counted, whatever became of those before it. Sourced by .ci/run.

passed=0 failed=0 skipped=0 times=""
report="$(mktemp)"
# Every run of pytest leaves its counts there, by whatever command it is started.
export PYTEST_ADDOPTS="${PYTEST_ADDOPTS:-} --junitxml=$report"

# part NAME COMMAND...: a run of pytest counts its tests, any other command counts as one. COMMAND may be a function; it
# ends at the first command in it that fails.
part() {
    local name="$1" began=$SECONDS status tests bad left
    shift
    echo "== $name"
    : > "$report"
    # No condition around it: `set -e` would not hold inside.
    (set -euo pipefail; "$@") < /dev/null
    status=$?
    read -r tests bad left < <("${PYTHON:-python3}" "$(dirname "${BASH_SOURCE[0]}")/count_tests.py" "$report" "$status")
    passed=$((passed + tests)) failed=$((failed + bad)) skipped=$((skipped + left))
    times+="$(printf '%6d s  %-6s  %s' $((SECONDS - began)) "$([ "$bad" = 0 ] && echo ok || echo FAILED)" "$name")"$'\n'
    echo "== $name: exit code $status after $((SECONDS - began)) s"
}

# skip NAME WHY: a part that cannot be run here.
skip() {
    skipped=$((skipped + 1))
    echo "SKIPPED: $1: $2"
    times+="$(printf '%8s  %-6s  %s: %s' "" skipped "$1" "$2")"$'\n'
}

# The seconds of each part, and the sum of all as the last line; the exit code tells whether anything failed.
finish() {
    rm -f "$report"
    printf '%s%6d s  in all\n' "$times" "$SECONDS"
    echo "$passed passed, $failed failed$([ "$skipped" = 0 ] || echo ", $skipped skipped")"
    [ "$failed" = 0 ]
}

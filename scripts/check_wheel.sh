#!/usr/bin/env bash
# Install a wheel into an environment of its own, where nothing has been compiled, and start it cold so many times.
#
#     scripts/check_wheel.sh [TIMES]
set -euo pipefail
cd "$(dirname "$0")/.."
fresh="$(mktemp -d)"
trap 'rm -rf "$fresh"' EXIT
.venv/bin/python -m pip wheel -q --no-deps --wheel-dir "$fresh" .
"${PYTHON:-python3}" -m venv "$fresh/venv"
"$fresh/venv/bin/python" -m pip install -q --disable-pip-version-check "$fresh"/*.whl
cp scripts/cold_starts.py "$fresh"
# Not from here, where the package itself would be found.
cd /
"$fresh/venv/bin/python" "$fresh/cold_starts.py" "${1:-3}"
